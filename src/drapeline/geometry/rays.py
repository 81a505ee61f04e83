"""Rays against triangle meshes by Warp."""

import numpy as np
import warp as wp

from drapeline.geometry.warp_mesh import warp_mesh

_DEVICE = "cpu"


@wp.kernel
def _find_any_hit(
    mesh: wp.uint64,
    starts: wp.array[wp.vec3],
    directions: wp.array[wp.vec3],
    reach: float,
    hit: wp.array[int],
):
    index = wp.tid()
    if wp.mesh_query_ray_anyhit(mesh, starts[index], directions[index], reach):
        hit[index] = 1


def rays_hit(
    starts: np.ndarray,
    directions: np.ndarray,
    vertices: np.ndarray,
    faces: np.ndarray,
    *,
    reach_m: float,
) -> np.ndarray:
    """(P,) whether rays meet a surface, from either side.

    Args:
        starts, directions: (P, 3) metres, and unit vectors.
        vertices, faces: (V, 3) and (F, 3) of the surface.
        reach_m: length of the rays.
    """
    mesh = warp_mesh(vertices, faces)
    places, ways = (
        wp.array(np.ascontiguousarray(a, dtype=np.float32), dtype=wp.vec3, device=_DEVICE)
        for a in (starts, directions)
    )
    hit = wp.zeros(len(starts), dtype=int, device=_DEVICE)
    wp.launch(
        _find_any_hit,
        dim=len(starts),
        inputs=[mesh.id, places, ways, reach_m],
        outputs=[hit],
        device=_DEVICE,
    )
    return hit.numpy().astype(bool)
