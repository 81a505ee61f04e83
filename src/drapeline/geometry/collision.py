"""A body as a solid: predicted cloth is pushed out of it."""

import numpy as np
import scipy.sparse as sp
import warp as wp

from drapeline.geometry.smoothing import averaging_matrix, fairing
from drapeline.geometry.warp_mesh import warp_mesh

_GAP_M = 0.004  # of pushed-out cloth from the body, as simulated cloth keeps
_DEEP_M = 0.1  # cloth deeper in the body than this is left there: the way out is a guess
_ROUNDS, _SPREAD = 3, 4  # of pushing, and of spreading a push over its neighbourhood
_EVENNESS = 10.0  # see `fairing`


@wp.kernel
def _measure(
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    push: wp.array(dtype=wp.vec3),
):
    index = wp.tid()
    point = points[index]
    hit = wp.mesh_query_point_no_sign(mesh, point, _DEEP_M)
    if hit.result:
        place = wp.mesh_eval_position(mesh, hit.face, hit.u, hit.v)
        away = point - place
        # The body is round: its faces are fine enough to tell inside from outside.
        height = wp.dot(away, wp.mesh_eval_face_normal(mesh, hit.face))
        distance = wp.sign(height) * wp.length(away)
        if distance < _GAP_M and wp.abs(distance) > 1.0e-6:
            push[index] = (_GAP_M / distance - 1.0) * away


class Solid:
    """A body that cloth is pushed out of; it moves and keeps its faces.

    Args:
        vertices: (B, 3) metres.
        faces: (F, 3), outwards.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        self._mesh = warp_mesh(vertices, faces)

    def move(self, vertices: np.ndarray) -> None:
        """Take another pose: vertices (B, 3) in metres."""
        self._mesh.points.assign(vertices)
        self._mesh.refit()

    def left_by(self, cloth: np.ndarray, average: sp.csr_matrix) -> np.ndarray:
        """Cloth (V, 3) pushed out of the body; pushes are spread, and the last one is exact."""
        moved_last = np.arange(len(cloth))
        for round_ in range(_ROUNDS):
            push = np.zeros_like(cloth)
            push[moved_last] = self._push(cloth[moved_last])
            if not push.any():
                break
            if round_ < _ROUNDS - 1:
                for _ in range(_SPREAD):
                    mean = average @ push
                    longer = (mean * mean).sum(1) > (push * push).sum(1)
                    push = np.where(longer[:, None], mean, push)
            cloth = (cloth + push).astype(np.float32)
            moved_last = np.flatnonzero(push.any(axis=1))  # the others are outside, and stay so
        return cloth

    def _push(self, cloth: np.ndarray) -> np.ndarray:
        """(V, 3) the way to where each vertex is outside by the gap; zero for those that are."""
        push = wp.zeros(len(cloth), dtype=wp.vec3, device="cpu")
        wp.launch(
            _measure,
            dim=len(cloth),
            inputs=[self._mesh.id, wp.array(cloth, dtype=wp.vec3, device="cpu")],
            outputs=[push],
            device="cpu",
        )
        return push.numpy()


def resolve_penetration(
    cloth: np.ndarray, faces: np.ndarray, bodies: np.ndarray, body_faces: np.ndarray
) -> np.ndarray:
    """Decoded cloth evened out and pushed out of the posed body; our own, no part of CLOTH3D.

    Skinning moves every vertex by weights of its own, so what a network leaves over of an error
    is rough; and an error of a centimetre is more than cloth keeps from the skin.

    Args:
        cloth: (N, M, 3) metres, frames of one garment.
        faces: (F, 3) of the garment.
        bodies: (N, B, 3) metres, its wearer in the same frames.
        body_faces: (G, 3), outwards.

    Returns:
        (N, M, 3) float32.

    Raises:
        ValueError: cloth and bodies are of unlike numbers of frames.
    """
    if len(cloth) != len(bodies):
        raise ValueError(
            f"{len(cloth)} frames of cloth came with {len(bodies)} bodies, expected one per frame"
        )
    average, solid = averaging_matrix(faces, cloth.shape[1]), Solid(bodies[0], body_faces)
    even = fairing(faces, average, _EVENNESS)
    out = np.zeros(cloth.shape, dtype=np.float32)
    for frame, (points, body) in enumerate(zip(cloth, bodies, strict=True)):
        solid.move(body)
        evened = even(points.astype(np.float64)).astype(np.float32)
        out[frame] = solid.left_by(evened, average)
    return out
