"""Collision of predicted cloth with a body: vertices inside it are pushed out."""

import numpy as np
import scipy.sparse as sp
import warp as wp

from drapeline.geometry.mesh import edges
from drapeline.geometry.smoothing import averaging_matrix, fairing, spread_pushes
from drapeline.geometry.warp_mesh import move_mesh, warp_mesh

_GAP_M = 0.004  # of pushed-out cloth from the body, as simulated cloth keeps
_DEEP_M = 0.1  # cloth deeper in the body than this is left there: the way out is a guess
_ROUNDS, _SPREAD = 3, 4  # of pushing, and of spreading each push over its neighbourhood
_FAIRING = 10.0  # strength, see `fairing`


@wp.kernel
def _push_to_gap(mesh: wp.uint64, points: wp.array[wp.vec3], push: wp.array[wp.vec3]):
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


class PenetrationResolver:
    """A body, (B, 3) metres and faces (F, 3) outwards, that cloth is pushed out of; it may move."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        self._mesh = warp_mesh(vertices, faces)

    def move(self, vertices: np.ndarray) -> None:
        """Take another pose: vertices (B, 3) in metres."""
        move_mesh(self._mesh, vertices)

    def push_out(self, cloth: np.ndarray, average: sp.csr_matrix) -> np.ndarray:
        """Cloth (V, 3) float32 pushed 4 mm out of the body; `cloth` itself if nothing moves.

        Pushes but the last are spread over the neighbourhood, so that the body does not emboss
        the cloth; the last one is exact.

        Args:
            cloth: (V, 3) metres.
            average: (V, V) of `averaging_matrix`.
        """
        moved_last = np.arange(len(cloth))
        for round_ in range(_ROUNDS):
            push = np.zeros_like(cloth)
            push[moved_last] = self._pushes(cloth[moved_last])
            if not push.any():
                break
            if round_ < _ROUNDS - 1:
                push = spread_pushes(push, average, _SPREAD)
            cloth = (cloth + push).astype(np.float32)
            moved_last = np.flatnonzero(push.any(axis=1))  # the others are outside, and stay so
        return cloth

    def push_faces_out(self, cloth: np.ndarray, faces: np.ndarray) -> np.ndarray:
        """Cloth (V, 3) float32 moved until middles of its faces (F, 3) and edges are outside too.

        Between vertices that are outside, coarse cloth may still cut through a body that bends.
        """
        parts = (edges(faces), faces)
        for _ in range(_ROUNDS):
            for corners in parts:
                push = self._pushes(cloth[corners].mean(axis=1).astype(np.float32))
                through = np.flatnonzero(push.any(axis=1))
                # Of several for a vertex the last one stays, which is the longest.
                order = through[np.argsort(np.linalg.norm(push[through], axis=1), kind="stable")]
                moved = np.zeros_like(cloth)
                for column in corners.T:
                    moved[column[order]] = push[order]
                cloth = (cloth + moved).astype(np.float32)
        return cloth

    def _pushes(self, points: np.ndarray) -> np.ndarray:
        """(P, 3) from each point to where it is outside by the gap; zero if it is already."""
        push = wp.zeros(len(points), dtype=wp.vec3, device="cpu")
        wp.launch(
            _push_to_gap,
            dim=len(points),
            inputs=[self._mesh.id, wp.array(points, dtype=wp.vec3, device="cpu")],
            outputs=[push],
            device="cpu",
        )
        return push.numpy()


def resolve_penetration(
    cloth: np.ndarray, faces: np.ndarray, bodies: np.ndarray, body_faces: np.ndarray
) -> np.ndarray:
    """Smooth decoded cloth and push it out of the posed body: (N, M, 3) float32; our own.

    Skinning moves every vertex by weights of its own, so that the errors a network leaves are
    rough; and an error of a centimetre is more than the distance of cloth from the skin.

    Args:
        cloth: (N, M, 3) metres, frames of one garment.
        faces: (F, 3) of the garment.
        bodies: (N, B, 3) metres, its wearer in the same frames.
        body_faces: (G, 3), outwards.

    Raises:
        ValueError: the numbers of frames of cloth and bodies differ.
    """
    if len(cloth) != len(bodies):
        raise ValueError(
            f"{len(cloth)} frames of cloth came with {len(bodies)} bodies, expected one per frame"
        )
    count = cloth.shape[1]
    average, remove_bumps = averaging_matrix(faces, count), fairing(faces, count, _FAIRING)
    resolver = PenetrationResolver(bodies[0], body_faces)
    out = np.zeros(cloth.shape, dtype=np.float32)
    for frame, (points, body) in enumerate(zip(cloth, bodies, strict=True)):
        resolver.move(body)
        smooth = remove_bumps(points.astype(np.float64)).astype(np.float32)
        out[frame] = resolver.push_out(smooth, average)
    return out
