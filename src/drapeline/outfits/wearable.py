"""Whether a garment at rest can be worn: the body's limbs pass through its openings.

Where they do not, turns, moves, scales and lowered arms are tried, and the error says which of them
would mend it.
"""

import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.rest_body import SHAPES
from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES, REST_POSE
from drapeline.geometry.mesh import Mesh, vertex_normals
from drapeline.outfits.openings import SIDES, limb_bones, limb_openings, passing_limbs

LOGGER = logging.getLogger("drapeline")
_HUGE_M = 5.0  # no garment for a person of 2 m is larger
_TINY_M = 0.05
_TOUCH_M = 0.12  # from the body to its nearest tenth of a garment
_CLOSE_SHARE = 0.1
_INSIDE_M = 0.01
_EXPECTED = (
    "expected it on the mean body in rest pose, in metres, Z up, facing -Y, the pelvis at the"
    " origin (`body_obj` writes that body)"
)


def check_wearable(path: str | Path, mesh: Mesh, body: BodyModel, *, mend: bool = False) -> Mesh:
    """Refuse a garment that the mean body in rest pose cannot have on, or mend it.

    A limb's bones pass through the openings meant for it, some of the garment is close to the body
    and most of it outside. Openings that nothing passes, such as a low back, are fine unless a turn
    lets something pass through all.

    Args:
        path: of the garment, for the error.
        mesh: with separate boundary loops.
        body: the one it is for.
        mend: whether to turn, move or scale it, and say so, where that lets the body wear it.

    Returns:
        The garment on the body.

    Raises:
        InputError: what is wrong, and the turn, move, scale or pose that would mend it.
    """
    wearer = _Wearer.of(body)
    loops = limb_openings(mesh.vertices, mesh.faces)
    points = mesh.vertices.astype(np.float64)
    found = _fit(points, loops, wearer)
    if not found.problem and found.all_passed:
        return mesh
    problem = found.problem or "nothing passes through one of the openings"
    for alike in _changes(points, wearer, body) if found.problem else [_turned(points, wearer)]:
        fits = [(_fit(changed, loops, who), words, changed, who) for words, changed, who in alike]
        fits = [one for one in fits if one[0].all_passed and not one[0].problem]
        if fits:
            _, words, changed, who = min(fits, key=lambda one: one[0].distance_m)
            if mend and who is wearer:
                LOGGER.warning("%s: %s; %s", path, problem, words)
                return replace(mesh, vertices=changed.astype(mesh.vertices.dtype))
            raise InputError(f"{path}: {problem}, but it fits if {words}; {_EXPECTED}")
    if found.problem:
        raise InputError(f"{path}: {problem}; {_EXPECTED}")
    return mesh


@dataclass(frozen=True)
class _Wearer:
    """A body at rest, relative to its root joint.

    Attributes:
        bones: (n, 2, 3) metres, from joint to joint, by limb.
    """

    vertices: np.ndarray
    normals: np.ndarray
    tree: KDTree
    bones: dict[str, np.ndarray]

    @classmethod
    def of(cls, body: BodyModel, lowered_deg: float = 0) -> "_Wearer":
        """The mean body in rest pose, with its arms lowered perhaps."""
        pose = REST_POSE.copy()
        for side, sign in zip(SIDES, (-1, 1), strict=True):
            pose[3 * JOINT_NAMES.index(f"{side}_shoulder") + 2] = sign * np.deg2rad(lowered_deg)
        posed, joints = posed_vertices(body, np.zeros(SHAPES), pose[None])
        vertices = posed[0].astype(np.float64)
        normals = vertex_normals(vertices, body.faces)
        return cls(vertices, normals, KDTree(vertices), limb_bones(joints[0]))


class _Fit(NamedTuple):
    """How well a garment lies on a body."""

    problem: str  # empty if there is none
    all_passed: bool  # whether a limb passes through each opening
    distance_m: float  # median


def _fit(points: np.ndarray, loops: list[np.ndarray], wearer: _Wearer) -> _Fit:
    passing = [passing_limbs(wearer.bones, points[loop]) for loop in loops]
    all_passed = all(passing)
    problem = _size_problem(points) or _opening_problem(points, loops, passing)
    if problem:
        return _Fit(problem, all_passed, np.inf)
    distance, nearest = wearer.tree.query(points)
    median = float(np.median(distance))
    if np.quantile(distance, _CLOSE_SHARE) > _TOUCH_M:
        x, y, z = points.mean(axis=0)
        problem = (
            f"the garment is {median:.2f} m from the rest body (median), its middle at"
            f" ({x:.2f}, {y:.2f}, {z:.2f}) m"
        )
    offset = points - wearer.vertices[nearest]
    inside = np.einsum("vc,vc->v", offset, wearer.normals[nearest]) < -_INSIDE_M
    if inside.mean() > 0.5:
        problem = f"{inside.mean():.0%} of the vertices are inside the body"
    return _Fit(problem, all_passed, median)


def _size_problem(points: np.ndarray) -> str:
    size = float(np.ptp(points, axis=0).max())
    return "" if _TINY_M < size < _HUGE_M else f"the garment is {size:.4g} m long"


def _opening_problem(points: np.ndarray, loops: list[np.ndarray], passing: list[set[str]]) -> str:
    middle, sides = _places(points, loops)
    for index, name, limbs in (
        (middle[:1], "highest", {"trunk"}),
        (middle[-1:], "lowest", {"trunk", "left leg", "right leg"}),
    ):
        if index and not passing[index[0]] & limbs:
            return f"the body does not pass through the {name} opening"
    for limb, openings in sides.items():
        if openings and not any(limb in passing[index] for index in openings):
            return f"the {limb} passes through no opening on its side"
    return ""


def _places(points: np.ndarray, loops: list[np.ndarray]) -> tuple[list[int], dict[str, list[int]]]:
    """Openings around the middle from the highest to the lowest, and those of each limb."""
    middle: list[int] = []
    sides: dict[str, list[int]] = {
        f"{side} {limb}": [] for side in SIDES for limb in ("arm", "leg")
    }
    for index, loop in enumerate(loops):
        x, _, z = points[loop].T
        if x.min() < 0 < x.max():
            middle.append(index)
        else:
            side = SIDES[int(x.mean() < 0)]
            sides[f"{side} {'arm' if z.mean() > 0 else 'leg'}"].append(index)
    return sorted(middle, key=lambda index: -points[loops[index], 2].mean()), sides


_TURNS = (("X", 90), ("X", -90), ("X", 180), ("Z", 90), ("Z", -90), ("Y", 90), ("Y", -90))
_UNITS = {"millimetres": 1e-3, "centimetres": 0.01, "inches": 0.0254}
_SCALES = (0.5, 0.6, 0.7, 0.8, 1.25, 1.5, 2)
_LOWERED_DEG = range(10, 90, 10)
_STEP_M = 0.05
_Change = tuple[str, np.ndarray, _Wearer]


def _changes(points: np.ndarray, wearer: _Wearer, body: BodyModel) -> Iterator[list[_Change]]:
    """What may be wrong with a garment, mended: words, vertices and body, the likely ones first."""
    turns = _turned(points, wearer)
    turned = [("", points), *((words, vertices) for words, vertices, _ in turns)]
    floor = np.array([0, 0, wearer.vertices[:, 2].min()])
    yield [_moved("", points, floor, wearer)]
    yield [(f"scaled by about {s:g}", s * points, wearer) for s in _SCALES]
    yield turns
    lowered = [(f"its arms are raised by about {angle} degrees", angle) for angle in _LOWERED_DEG]
    yield [(words, points, _Wearer.of(body, angle)) for words, angle in lowered]
    yield _heights("", points, wearer)
    yield [_moved(words, vertices, floor, wearer) for words, vertices in turned]
    units = [
        (_joined(words, f"its unit is {unit}"), size * vertices)
        for unit, size in _UNITS.items()
        for words, vertices in turned
    ]
    yield [(words, vertices, wearer) for words, vertices in units]
    yield [_moved(words, vertices, floor, wearer) for words, vertices in units]
    for words, vertices in turned[1:]:
        yield _heights(words, vertices, wearer)


def _turned(points: np.ndarray, wearer: _Wearer) -> list[_Change]:
    changes = []
    for axis, angle in _TURNS:
        turn = Rotation.from_euler(axis.lower(), angle, degrees=True).as_matrix()
        changes.append((f"turned by {angle} degrees about {axis}", points @ turn.T, wearer))
    return changes


def _heights(words: str, points: np.ndarray, wearer: _Wearer) -> list[_Change]:
    """A garment moved above the origin and to any height."""
    low, high = points.min(axis=0), points.max(axis=0)
    x, y = -(low + high)[:2] / 2
    ends = wearer.vertices[:, 2].max(), wearer.vertices[:, 2].min()
    heights = np.arange(*ends, -_STEP_M) - high[2]
    return [_moved(words, points, np.array([x, y, z]), wearer) for z in heights]


def _moved(words: str, points: np.ndarray, shift: np.ndarray, wearer: _Wearer) -> _Change:
    x, y, z = shift
    return _joined(words, f"moved by ({x:.2f}, {y:.2f}, {z:.2f}) m"), points + shift, wearer


def _joined(*words: str) -> str:
    return " and ".join(filter(None, words))
