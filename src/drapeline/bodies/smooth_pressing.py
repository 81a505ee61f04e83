"""Corrections of self-collisions that change smoothly over frames.

Frames that are solved one by one get planes that jump: cloth that lies on the body would be shaken.
So each vertex is moved by a smooth envelope of its corrections, about as far as each of them asks,
and what then overlaps is solved again. N frames at 30 fps, K vertices that are ever moved.
"""

from dataclasses import replace

import numpy as np
from scipy.ndimage import binary_dilation, gaussian_filter1d

from drapeline.bodies.kinematics import axis_angle_to_matrix, joint_transforms
from drapeline.bodies.self_collision import (
    PAIRS,
    PART_NAMES,
    BodyParts,
    Solution,
    solve_self_collisions,
)

_ROUNDS = 2  # of solving and smoothing, the first solution included
_SPREAD_FRAMES = 2.0  # standard deviation in time
_REACH_FRAMES = 5  # corrections spread over so many frames either way
_LIFTS = 8  # after so many, hardly anything lacks a millimetre
_LEAST_M = 2e-5  # shorter corrections are left out


def smooth_corrections(
    vertices: np.ndarray,
    poses: np.ndarray,
    segmentation: np.ndarray,
    parts: BodyParts,
    solution: Solution,
    *,
    gap_m: float,
) -> Solution:
    """Make the corrections of a sequence smooth, without parts that overlap.

    Args:
        vertices: (N, V, 3) posed body in metres, root-relative.
        poses: (N, 72) axis-angle, rad.
        segmentation: (V,) the joint whose part each vertex belongs to.
        parts: of the body.
        solution: of all frames, one by one.
        gap_m: between separated parts.

    Returns:
        The solution with other corrections; the rest of it is still about single frames.
    """
    if not len(solution.frame):
        return solution
    rotations = axis_angle_to_matrix(np.asarray(poses, dtype=np.float64).reshape(-1, 24, 3))
    turns = joint_transforms(np.zeros((24, 3)), rotations)[0][..., :3]
    moves = np.zeros_like(vertices)
    found = solution
    for attempt in range(_ROUNDS):
        if attempt:
            # Only what has collided close by in time; this leaves out what is removed as well.
            found = solve_self_collisions(
                vertices + moves,
                parts,
                gap_m=gap_m,
                suspects=binary_dilation(solution.depth_m > 0, np.ones((2 * _REACH_FRAMES + 1, 1))),
            )
        moves[found.frame, found.vertex] += found.delta
        if not attempt:
            _forget_outliers(moves, solution, parts)
        moved = np.flatnonzero(moves.any(axis=(0, 2)))
        own = turns[:, segmentation[moved]]  # (N, K, 3, 3)
        local = np.einsum("nkba,nkb->nka", own, moves[:, moved])
        moves[:, moved] = np.einsum("nkab,nkb->nka", own, _envelope(local))
    kept = np.linalg.norm(moves, axis=2) > _LEAST_M
    frame, vertex = np.nonzero(kept)
    return replace(
        solution,
        frame=frame.astype(np.int32),
        vertex=vertex.astype(np.int32),
        delta=moves[kept],
    )


def _forget_outliers(moves: np.ndarray, solution: Solution, parts: BodyParts) -> None:
    """Leave out, in place, moves (N, V, 3) of parts that are too deep in a single frame.

    There a plane was laid the wrong way; what the frames around it ask for comes in its place.
    """
    alone = (solution.depth_m > solution.limit_m) & ~solution.unsolved()
    for frame, index in np.argwhere(alone):
        for name in (PAIRS[index].first, PAIRS[index].second):
            moves[frame, parts.part_vertices[PART_NAMES.index(name)]] = 0


def _envelope(moves: np.ndarray) -> np.ndarray:
    """Smooth moves (N, K, 3) that go as far as the given ones (N, K, 3) along each of these."""
    length = np.linalg.norm(moves, axis=2)
    ways = moves / np.maximum(length, 1e-9)[..., None]
    smooth = np.zeros_like(moves)
    for _ in range(_LIFTS):
        lack = np.maximum(length - np.einsum("nka,nka->nk", smooth, ways), 0)
        smooth += gaussian_filter1d(
            lack[..., None] * ways,
            _SPREAD_FRAMES,
            axis=0,
            mode="nearest",
            radius=_REACH_FRAMES // 2,
        )
    return smooth
