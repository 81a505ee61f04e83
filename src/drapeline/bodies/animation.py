"""Animate a body: put a motion on a shape and free it of self-collisions (CLOTH3D 3.1)."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from drapeline.bodies.contact import floor_contact
from drapeline.bodies.model import BodyModel, posed_vertices, shape_body
from drapeline.bodies.motion_fit import fit_motion, lift_supports
from drapeline.bodies.overlap import measure_overlap
from drapeline.bodies.self_collision import (
    PAIRS,
    PART_JOINTS,
    PART_NAMES,
    BodyParts,
    Pair,
    Solution,
    body_parts,
    depth_limits,
    solve_self_collisions,
)
from drapeline.bodies.sequence import BodySequence, ClipLabels, press_apart
from drapeline.bodies.smooth_pressing import smooth_corrections
from drapeline.frames import JOINT_NAMES

# The floor is at this percentile of the frames' lowest points: a single stray frame must not lift
# the whole clip off the ground.
FLOOR_PERCENTILE = 5.0


def leg_length_m(body: BodyModel, shape: np.ndarray) -> float:
    """Hip to knee to ankle, mean of both legs."""
    _, joints = shape_body(body, shape)
    lengths = []
    for side in ("left", "right"):
        hip, knee, ankle = (
            joints[JOINT_NAMES.index(f"{side}_{name}")] for name in ("hip", "knee", "ankle")
        )
        lengths.append(np.linalg.norm(knee - hip) + np.linalg.norm(ankle - knee))
    return float(np.mean(lengths))


def _path_scale(body: BodyModel, shape: np.ndarray, reference_leg_length_m: float | None) -> float:
    if reference_leg_length_m is None:
        return 1.0
    return leg_length_m(body, shape) / reference_leg_length_m


def place_on_floor(vertices: np.ndarray, trans: np.ndarray, scale: float) -> np.ndarray:
    """(N, 3) float64 path of the body's root joint, scaled and set on the floor.

    Args:
        vertices: (N, V, 3) posed body relative to its root joint, metres.
        trans: (N, 3) root path of the skeleton that was recorded, metres, Z up.
        scale: leg length of this body over that of the skeleton.
    """
    path = np.array(trans, dtype=np.float64)
    path = path[0] * [1, 1, 0] + (path - path[0] * [1, 1, 0]) * scale
    lowest = vertices[:, :, 2].min(axis=1) + path[:, 2]
    path[:, 2] -= np.percentile(lowest, FLOOR_PERCENTILE)
    return path


# Limbs that may be left out of collisions, by what the outfit leaves bare.
REMOVABLE = {"hands": ("hand",), "forearms": ("hand", "forearm")}
THINNER_STEP = 1.0  # of the shape's second coefficient, corpulence
MAX_THINNED = 3
GLANCE_STEP = 10  # between the frames that are looked at first
_UNLABELLED = ClipLabels()


def make_body_sequence(
    body: BodyModel, shape: np.ndarray, poses: np.ndarray, trans: np.ndarray, **options: Any
) -> BodySequence:
    """Put a motion on a body of one shape (10,); see `first_free_sequence`."""
    return first_free_sequence(body, [shape], poses, trans, **options)


def first_free_sequence(
    body: BodyModel,
    shapes: Iterable[np.ndarray],
    poses: np.ndarray,
    trans: np.ndarray,
    *,
    gender: str,
    reference_leg_length_m: float | None = None,
    removable: str = "hands",
    shape_range: float = 3.0,
    gap_m: float = 0.004,
    adapt: bool = True,
    labels: ClipLabels = _UNLABELLED,
) -> BodySequence:
    """Put a motion on a body and free it of self-collisions (CLOTH3D 3.1).

    Small overlaps are pressed apart. For larger ones, parts are left out where the outfit allows
    it; else the body is made thinner, step by step; else CLOTH3D rejects the sequence, and another
    shape may pass.

    Args:
        shapes: (10,) shape coefficients each, at least one, taken only as far as needed.
        poses: (N, 72) axis-angle in radians.
        trans: (N, 3) world position of the motion's own root joint in metres.
        gender: "female" or "male".
        reference_leg_length_m: leg length of the skeleton the motion was recorded on; the root's
            path is scaled by the ratio of leg lengths. None keeps poses and path, which is only
            lifted to the floor.
        removable: what the outfit leaves bare, a key of `REMOVABLE`.
        shape_range: largest magnitude of a coefficient; no body is made thinner than that.
        gap_m: between parts that were pressed apart, metres.
        adapt: whether poses are changed such that what supports the body is held on the floor and
            limbs keep clear of the trunk, see `motion_fit.fit_motion`; with a reference alone.

    Returns:
        The sequence, with the number of shapes given up; that of the last shape if all are
        rejected.
    """
    parts = body_parts(body)
    order = _spread(len(poses))
    clip = poses = np.array(poses, dtype=np.float64)
    fitted = adapt and reference_leg_length_m is not None
    for redrawn, drawn in enumerate(shapes):  # noqa: B007
        shape = np.array(drawn, dtype=np.float64)
        if fitted:
            scale = _path_scale(body, shape, reference_leg_length_m)
            path = place_on_floor(posed_vertices(body, shape, clip)[0], trans, scale)
            poses, path, supports = fit_motion(body, shape, clip, path)
        freed, order = _free(body, parts, shape, poses, removable, shape_range, gap_m, order)
        if freed is not None:
            break
    else:
        freed = _solve(body, parts, shape, poses, None, gap_m)  # all frames, for the record
    solution = freed.solution
    if freed.free:
        solution = smooth_corrections(
            freed.vertices, poses, body.segmentation, parts, solution, gap_m=gap_m
        )
    if not fitted:
        scale = _path_scale(body, freed.shape, reference_leg_length_m)
        path = place_on_floor(freed.vertices, trans, scale)
    elif freed.thinned:
        path = lift_supports(freed.vertices, path, supports.flight)
    removed_segments = _joints_of(solution.removed)
    pressed = freed.vertices.copy()
    press_apart(pressed, np.arange(len(pressed)), solution.frame, solution.vertex, solution.delta)
    collides = ~np.isin(body.segmentation, removed_segments)
    overlap = measure_overlap(body, pressed, collides)
    contact = floor_contact(freed.vertices, path, body.segmentation)
    collided = (solution.depth_m > 0).any(axis=1)
    return BodySequence(
        shape=freed.shape,
        gender=gender,
        poses=poses,
        trans=path,
        outcome=_outcome(
            deep=bool(solution.unsolved().any()),
            thinned=freed.thinned,
            removed=bool(solution.removed),
            collided=bool(collided.any()),
        ),
        reason=_reason(solution, removable),
        thinned=freed.thinned,
        redrawn=redrawn,
        removed_segments=removed_segments,
        fix_frame=solution.frame,
        fix_vertex=solution.vertex,
        fix_delta=solution.delta,
        collided_frames=int(collided.sum()),
        deepest_m=float(np.linalg.norm(solution.delta, axis=1).max(initial=0)),
        overlap_share=overlap.share,
        overlap_depth_m=overlap.depth_m,
        penetration_m=contact.penetration_m,
        sliding_m_s=contact.sliding_m_s,
        hover_s=contact.hover_s,
        flight_s=contact.flight_s,
        labels=labels,
    )


@dataclass(frozen=True)
class _Freed:
    """A body in motion after its parts were pressed apart."""

    shape: np.ndarray  # (10,)
    vertices: np.ndarray  # (N, V, 3) root-relative, as posed
    solution: Solution
    thinned: int = 0  # how many times the body was made thinner

    @property
    def free(self) -> bool:
        """Whether nothing is too deep."""
        return not self.solution.unsolved().any()


def _free(
    body: BodyModel,
    parts: BodyParts,
    shape: np.ndarray,
    poses: np.ndarray,
    removable: str,
    shape_range: float,
    gap_m: float,
    order: np.ndarray,
) -> tuple[_Freed | None, np.ndarray]:
    """The body, or a thinner one, whose collisions are solved in all frames; None if none is.

    A shape is given up with its first frame that nothing cures, so those that are likely to be it
    come first, in the given order (N,); what stopped this body will likely stop the next, whose
    order comes back.
    """
    found = _solve(body, parts, shape, poses, removable, gap_m, order)
    if found.free:
        return found, order
    order = _near_the_worst(found.solution)
    for times, thin in enumerate(_thinner_shapes(body, shape, shape_range), 1):
        found = _solve(body, parts, thin, poses, removable, gap_m, order)
        if found.free:
            return replace(found, thinned=times), order
        order = _near_the_worst(found.solution)
    return None, order


def _spread(count: int) -> np.ndarray:
    """So many frames (N,), every tenth of them first."""
    return np.argsort(np.arange(count) % GLANCE_STEP, kind="stable")


def _near_the_worst(solution: Solution) -> np.ndarray:
    """Frames (N,) by how far they are from that with the deepest collision."""
    deepest = np.where(solution.unsolved(), solution.depth_m, 0).max(axis=1)
    return np.argsort(np.abs(np.arange(len(deepest)) - deepest.argmax()), kind="stable")


def _outcome(deep: bool, thinned: int, removed: bool, collided: bool) -> str:
    if deep:
        return "rejected"
    if thinned:
        return "thinned"
    if removed:
        return "removed"
    return "solved" if collided else "free"


def _reason(solution: Solution, removable: str) -> str:
    deep = np.where(solution.unsolved(), solution.depth_m, 0)
    if not deep.any():
        return ""
    incurable = deep * [not _cure(pair, removable) for pair in PAIRS]
    if incurable.any():  # what may be left out is not what it was rejected for
        deep = incurable
    frame, index = np.unravel_index(deep.argmax(), deep.shape)
    pair = PAIRS[index]
    return (
        f"{pair.first} and {pair.second} overlap by {1000 * deep.max():.0f} mm in frame {frame},"
        f" at most {1000 * solution.limit_m[index]:.0f} mm can be pressed apart,"
        " and no thinner body helps"
    ).replace("_", " ")


def _solve(
    body: BodyModel,
    parts: BodyParts,
    shape: np.ndarray,
    poses: np.ndarray,
    removable: str | None,
    gap_m: float,
    order: np.ndarray | None = None,
) -> _Freed:
    """Press parts apart, or leave those out that may be, until it is seen that neither helps.

    All frames are solved, with all parts, if `removable` is None.
    """
    vertices, _ = posed_vertices(body, shape, poses)
    cures = None if removable is None else [_cure(pair, removable) for pair in PAIRS]
    solution = solve_self_collisions(
        vertices,
        parts,
        gap_m=gap_m,
        limit_m=depth_limits(parts, shape_body(body, shape)[0]),
        cures=cures,
        order=order,
    )
    return _Freed(shape, vertices, solution)


def _thinner_shapes(body: BodyModel, shape: np.ndarray, shape_range: float) -> Iterator[np.ndarray]:
    """The same person with less and less corpulence, down to the thinnest in range."""
    sign = _thinner_direction(body)
    for step in range(1, MAX_THINNED + 1):
        thin = shape.copy()
        thin[1] += sign * step * THINNER_STEP
        if abs(thin[1]) > shape_range and thin[1] * sign > 0:
            return
        yield thin


def _thinner_direction(body: BodyModel) -> float:
    """Sign of the second shape coefficient that takes volume away."""
    outward = np.zeros_like(body.v_template)
    corners = [body.v_template[body.faces[:, i]] for i in range(3)]
    cross = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    for i in range(3):
        np.add.at(outward, body.faces[:, i], cross)
    return -1.0 if np.sum(outward * body.shapedirs[:, :, 1]) > 0 else 1.0


def _cure(pair: Pair, removable: str) -> frozenset[str]:
    """Parts of a pair that may be left out, with those further out; none if there are no such."""
    allowed = REMOVABLE[removable]
    removed: set[str] = set()
    for part in (pair.first, pair.second):
        side, _, limb = part.partition("_")
        if limb in allowed:
            removed |= {f"{side}_{beyond}" for beyond in allowed[: allowed.index(limb) + 1]}
    return frozenset(removed)


def _joints_of(parts: frozenset[str]) -> np.ndarray:
    names = [name for part in PART_NAMES if part in parts for name in PART_JOINTS[part]]
    return np.array([JOINT_NAMES.index(name) for name in names], dtype=np.int32)
