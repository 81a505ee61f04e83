"""Views of a camera, exact: depth, normals, segments and what vertices carry, by casting rays."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from drapeline.geometry.mesh import triangulate, vertex_normals
from drapeline.geometry.warp_mesh import warp_mesh
from drapeline.rendering.camera import Camera


@dataclass(frozen=True)
class Seen:
    """Images of height H and width W; where nothing is hit everything is 0."""

    depth: np.ndarray  # (H, W) float32 metres along the optical axis
    normals: np.ndarray  # (H, W, 3) float32 unit surface normals, world axes, towards the camera
    carried: np.ndarray  # (H, W, C) float32, numbers of the vertices, such as velocities
    segments: np.ndarray  # (H, W) uint8, 0 for nothing, else 1 + index of the mesh


@wp.kernel
def _cast(
    mesh: wp.uint64,
    origin: wp.vec3,
    rays: wp.array[wp.vec3],
    depth: wp.array[float],
    face: wp.array[int],
    corner: wp.array[wp.vec2],
):
    pixel = wp.tid()
    hit = wp.mesh_query_ray(mesh, origin, rays[pixel], 1.0e3)
    face[pixel] = -1
    if hit.result:
        depth[pixel] = hit.t
        face[pixel] = hit.face
        corner[pixel] = wp.vec2(hit.u, hit.v)


def cast_rays(meshes: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], camera: Camera) -> Seen:
    """Cast one ray through the centre of every pixel.

    Meshes have vertices (V, 3) in world metres, faces (F, 3) or (F, 4), and numbers (V, C) that the
    vertices carry and that are interpolated.
    """
    height, width = camera.height, camera.width
    vertices = np.concatenate([m[0] for m in meshes]).astype(np.float32)
    triangles = [triangulate(m[1]) for m in meshes]
    normals = np.concatenate(
        [vertex_normals(m[0], t) for m, t in zip(meshes, triangles, strict=True)]
    )
    carried = np.concatenate([m[2] for m in meshes])
    starts = np.cumsum([0, *(len(m[0]) for m in meshes)])
    corners = np.concatenate([t + s for t, s in zip(triangles, starts[:-1], strict=True)])
    owner = np.repeat(np.arange(1, len(meshes) + 1), [len(t) for t in triangles])
    rays = camera.rays().reshape(-1, 3)
    device = "cpu"
    mesh = warp_mesh(vertices, corners)
    depth = wp.zeros(len(rays), dtype=float, device=device)
    face = wp.zeros(len(rays), dtype=int, device=device)
    corner = wp.zeros(len(rays), dtype=wp.vec2, device=device)
    wp.launch(
        _cast,
        dim=len(rays),
        inputs=[
            mesh.id,
            wp.vec3(*camera.position),
            wp.array(rays.astype(np.float32), dtype=wp.vec3, device=device),
        ],
        outputs=[depth, face, corner],
        device=device,
    )
    hit = face.numpy() >= 0
    where = corners[face.numpy()[hit]]  # (P, 3)
    first, second = corner.numpy()[hit].T
    weights = np.stack([first, second, 1 - first - second], -1)[..., None]
    facing = (normals[where] * weights).sum(1)
    facing /= np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-20)
    facing *= -np.sign((facing * rays[hit]).sum(1, keepdims=True))

    def image(values: np.ndarray, dtype: type) -> np.ndarray:
        flat: np.ndarray = np.zeros((len(hit), *values.shape[1:]), dtype=dtype)
        flat[hit] = values
        return flat.reshape(height, width, *values.shape[1:])

    return Seen(
        image(depth.numpy()[hit], np.float32),
        image(facing, np.float32),
        image((carried[where] * weights).sum(1), np.float32),
        image(owner[face.numpy()[hit]], np.uint8),
    )
