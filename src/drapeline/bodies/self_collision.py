"""Press colliding body parts apart so that two layers of cloth fit between (CLOTH3D 3.1).

Parts that overlap leave no room for cloth: its repelling forces would point both ways at once.
Where edges of one part cross faces of another, a plane is laid through the crossings and each
part's vertices are moved to their own side of it. Collisions that are too deep are reported.
"""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import warp as wp
from scipy.sparse import csr_matrix

from drapeline.bodies.model import BodyModel
from drapeline.frames import JOINT_NAMES
from drapeline.geometry.mesh import cross_rows, edges
from drapeline.geometry.warp_mesh import start_warp

wp.set_module_options({"enable_backward": False})

TORSO = ("pelvis", "spine1", "spine2", "spine3", "left_collar", "right_collar")
LIMBS = {
    "upper_arm": ("shoulder",),
    "forearm": ("elbow",),
    "hand": ("wrist", "hand"),
    "thigh": ("hip",),
    "shin": ("knee",),
    "foot": ("ankle", "foot"),
}
PART_JOINTS = {
    "torso": TORSO,
    "head": ("neck", "head"),
    **{
        f"{side}_{limb}": tuple(f"{side}_{joint}" for joint in joints)
        for side in ("left", "right")
        for limb, joints in LIMBS.items()
    },
}
PART_NAMES = tuple(PART_JOINTS)

# Flesh beside a joint folds and an arm lies against the chest: overlaps there may be pressed apart
# by this much ...
FOLD_LIMIT_M = 0.06
# ... while for all other parts a deeper overlap means two solids in one place.
TOUCH_LIMIT_M = 0.03
# Flesh that is thick yields more: this share of how far the surfaces of both parts are from their
# axes on average. It is the fold limit for a thigh and a torso of a body mass index of 23.
FLESH_SHARE = 0.32


@dataclass(frozen=True)
class Pair:
    """Two parts that may collide, and how deep a collision can be solved."""

    first: str
    second: str
    limit_m: float  # for any body, however thin


def _pairs() -> tuple[Pair, ...]:
    folds = [("head", "torso")]
    touches = [
        # Cloth lies between thighs, and would be caught between thighs that overlap more deeply.
        ("left_thigh", "right_thigh"),
        ("left_hand", "right_hand"),
        ("left_forearm", "right_forearm"),
        ("left_shin", "right_shin"),
        ("left_foot", "right_foot"),
    ]
    for side, other in (("left", "right"), ("right", "left")):
        folds += [
            (f"{side}_upper_arm", "torso"),
            (f"{side}_forearm", "torso"),
            (f"{side}_forearm", f"{side}_upper_arm"),
            (f"{side}_thigh", "torso"),
            (f"{side}_shin", f"{side}_thigh"),
        ]
        for limb in ("forearm", "hand"):
            touches.append((f"{side}_{limb}", "head"))
            touches += [
                (f"{side}_{limb}", f"{leg}_{segment}")
                for leg in ("left", "right")
                for segment in ("thigh", "shin")
            ]
            touches.append((f"{side}_{limb}", f"{other}_upper_arm"))
        touches += [
            (f"{side}_hand", "torso"),
            (f"{side}_hand", f"{other}_forearm"),
            (f"{side}_hand", f"{side}_upper_arm"),
            (f"{side}_upper_arm", "head"),
            (f"{side}_shin", f"{other}_thigh"),
            (f"{side}_foot", f"{other}_shin"),
            (f"{side}_foot", f"{side}_thigh"),
            (f"{side}_foot", "torso"),
            (f"{side}_shin", "torso"),
        ]
    return (
        *(Pair(a, b, FOLD_LIMIT_M) for a, b in folds),
        *(Pair(a, b, TOUCH_LIMIT_M) for a, b in touches),
    )


PAIRS = _pairs()


@dataclass(frozen=True)
class BodyParts:
    """Parts of a body's mesh, as far as they do not change with the pose."""

    faces: np.ndarray  # (F, 3)
    part_vertices: tuple[np.ndarray, ...]  # ids of each part's vertices
    part_edges: tuple[np.ndarray, ...]  # (E', 2) edges within each part
    part_faces: tuple[np.ndarray, ...]  # (F', 3) faces with two or three corners in each part
    faces_of: csr_matrix  # (V, F) sparse, with ones where a face has a vertex
    neighbours: csr_matrix  # (V, V) sparse adjacency with ones on the diagonal
    # (V, P) bool, vertices within two rings of each part: where parts join, their closeness means
    # nothing.
    seam: np.ndarray

    def around(self, ids: np.ndarray) -> np.ndarray:
        """Vertices `ids` (n,) and those that share an edge with one of them, sorted."""
        starts = self.neighbours.indptr[ids]
        counts = self.neighbours.indptr[ids + 1] - starts
        # Places of all entries of these rows; slicing the matrix takes several times as long.
        first = np.cumsum(counts) - counts
        places = np.arange(counts.sum()) + np.repeat(starts - first, counts)
        return np.unique(self.neighbours.indices[places])


def part_of_joint() -> np.ndarray:
    """(24,) index into `PART_NAMES` of the part that each joint moves."""
    owner = {joint: i for i, joints in enumerate(PART_JOINTS.values()) for joint in joints}
    return np.array([owner[name] for name in JOINT_NAMES])


def body_parts(body: BodyModel) -> BodyParts:
    """Parts and adjacency of a body."""
    count, faces = len(body.v_template), body.faces
    part = part_of_joint()[body.segmentation]
    pairs = edges(faces)
    ones = np.ones(faces.size, dtype=np.float32)
    rows = np.arange(len(faces)).repeat(3)
    around = np.concatenate([pairs, pairs[:, ::-1], np.arange(count)[:, None].repeat(2, 1)])
    parts = range(len(PART_NAMES))
    neighbours = csr_matrix(
        (np.ones(len(around), dtype=np.float32), around.T), shape=(count, count)
    )
    member = np.eye(len(PART_NAMES), dtype=np.float32)[part]
    return BodyParts(
        faces,
        tuple(np.flatnonzero(part == p) for p in parts),
        tuple(pairs[(part[pairs] == p).all(axis=1)] for p in parts),
        tuple(faces[(part[faces] == p).sum(axis=1) >= 2] for p in parts),
        csr_matrix((ones, (faces.ravel(), rows)), shape=(count, len(faces))),
        neighbours,
        neighbours @ (neighbours @ member) > 0,
    )


_DEVICE = "cpu"
_NEAR_M = wp.constant(wp.float64(0.06))  # how deep inside a part a vertex is recognised as such
# About an edge: this close to the surface the nearest vertex may lie aside.
_SHALLOW_M = wp.constant(wp.float64(0.015))
_STEEP = wp.constant(wp.float64(0.5))


@wp.func
def _area_vector(points: wp.array[wp.vec3], face: wp.vec3i):
    a = points[face[0]]
    vector = wp.cross(points[face[1]] - a, points[face[2]] - a)
    return wp.vec3d(wp.float64(vector[0]), wp.float64(vector[1]), wp.float64(vector[2]))


@wp.func
def _way(start: wp.vec3, end: wp.vec3):
    way = end - start
    return wp.vec3d(wp.float64(way[0]), wp.float64(way[1]), wp.float64(way[2]))


@wp.kernel
def _mark_inside(
    points: wp.array[wp.vec3],
    before: wp.array[wp.vec3],
    faces: wp.array[wp.vec3i],
    first_face: wp.array[int],  # of each vertex, in the list of
    face_numbers: wp.array[int],
    asked: wp.array[int],
    question: wp.array[int],
    others: wp.array[int],
    first_other: wp.array[int],  # of each question
    inside: wp.array[int],
):
    i = wp.tid()
    point = points[asked[i]]
    nearest = int(-1)  # noqa: RUF046, UP018
    squared = _NEAR_M * _NEAR_M
    for k in range(first_other[question[i]], first_other[question[i] + 1]):
        way = _way(points[others[k]], point)
        length = wp.dot(way, way)
        if length < squared:
            squared = length
            nearest = others[k]
    if nearest < 0:
        inside[i] = 0
        return
    normal = wp.vec3d()
    for k in range(first_face[nearest], first_face[nearest + 1]):
        normal += _area_vector(before, faces[face_numbers[k]])
    height = wp.dot(_way(points[nearest], point), wp.normalize(normal))
    distance = wp.sqrt(squared)
    # Deep inside, the nearest vertex lies straight above; beside it, only where a part ends.
    steep = distance < _SHALLOW_M or height < -_STEEP * distance
    inside[i] = int(height < wp.float64(0.0) and steep)


class InsideParts:
    """Tells which vertices lie behind the nearest ones of other parts."""

    def __init__(self, parts: BodyParts) -> None:
        start_warp()
        count = parts.faces_of.shape[0]
        self._points, self._before = (
            wp.zeros(count, dtype=wp.vec3, device=_DEVICE) for _ in range(2)
        )
        faces, first, numbers = (
            wp.array(np.ascontiguousarray(x, dtype=np.int32), dtype=kind, device=_DEVICE)
            for x, kind in (
                (parts.faces, wp.vec3i),
                (parts.faces_of.indptr, int),
                (parts.faces_of.indices, int),
            )
        )
        self._body = [self._points, self._before, faces, first, numbers]
        self._reserve(1)

    def _reserve(self, size: int) -> None:
        """Make room for as many vertices, others and questions; new arrays take their time."""
        self._size = size
        self._asked, self._question, self._others, self._first, self._inside = (
            wp.zeros(size + 1, dtype=int, device=_DEVICE) for _ in range(5)
        )
        self._launch = wp.launch(
            _mark_inside,
            dim=1,
            inputs=[*self._body, self._asked, self._question, self._others, self._first],
            outputs=[self._inside],
            device=_DEVICE,
            record_cmd=True,
        )

    def __call__(
        self,
        vertices: np.ndarray,
        before: np.ndarray,
        questions: Sequence[tuple[np.ndarray, np.ndarray]],
    ) -> list[np.ndarray]:
        """Those of some vertices that lie behind the nearest of others, for each question.

        Args:
            vertices: (V, 3) float32, metres.
            before: (V, 3) float32, whose normals count.
            questions: ids (n,) of vertices, and ids (m,) of the others.
        """
        asked, others = ([q[side] for q in questions] for side in (0, 1))
        counts = [len(ids) for ids in asked]
        total = sum(counts)
        if not total:
            return asked
        first = np.cumsum([0, *map(len, others)])
        needed = max(total, len(questions), int(first[-1]))
        if needed > self._size:
            self._reserve(2 * needed)
        self._points.numpy()[:] = vertices
        self._before.numpy()[:] = before
        self._asked.numpy()[:total] = np.concatenate(asked)
        self._question.numpy()[:total] = np.repeat(np.arange(len(questions)), counts)
        self._others.numpy()[: first[-1]] = np.concatenate(others)
        self._first.numpy()[: len(first)] = first
        self._launch.set_dim(total)
        self._launch.launch()
        marked = np.split(self._inside.numpy()[:total] > 0, np.cumsum(counts)[:-1])
        return [ids[mark] for ids, mark in zip(asked, marked, strict=True)]


MARGIN_M = 0.005  # around the box that two parts share
LINK_M = 0.03  # crossings further apart than this belong to different contacts
PASSES = 4


@dataclass(frozen=True)
class Solution:
    """Sparse corrections of a sequence, and how deep each collision was."""

    # frame, vertex: (m,) int32.
    frame: np.ndarray
    vertex: np.ndarray
    delta: np.ndarray  # (m, 3) float32 metres
    # (N, P) float32 greatest distance that a vertex of each of the `PAIRS` had to move in each
    # frame; 0 where the parts do not collide.
    depth_m: np.ndarray
    limit_m: np.ndarray  # (P,) of these depths
    leftover: np.ndarray  # (N, P) bool, parts that still cross after the last pass
    removed: frozenset[str]  # names of the parts that were left out

    def unsolved(self) -> np.ndarray:
        """(N, P) bool: deeper than the pair's limit, in two frames in a row if there are more."""
        return _too_deep(self.depth_m, self.limit_m)


def _too_deep(depth_m: np.ndarray, limit_m: np.ndarray) -> np.ndarray:
    """(N, P) bool: depths (N, P) above their limits (P,), but for single frames.

    Nothing goes so deep and comes back in a frame: there, a plane was laid the wrong way.
    """
    deep = depth_m > limit_m
    if len(deep) > 2:
        padded = np.pad(deep, ((1, 1), (0, 0)))
        deep &= padded[:-2] | padded[2:]
    return deep


def depth_limits(parts: BodyParts, rest: np.ndarray) -> np.ndarray:
    """(P,) float32 depth in metres that each of the `PAIRS` may have in a body.

    Args:
        rest: (V, 3) the shaped body at rest, metres.
    """
    thickness = {}
    for name, ids in zip(PART_NAMES, parts.part_vertices, strict=True):
        places = rest[ids] - rest[ids].mean(axis=0) if len(ids) else np.zeros((1, 3))
        axis = np.linalg.eigh(places.T @ places)[1][:, 2]
        thickness[name] = np.linalg.norm(np.cross(places, axis), axis=1).mean()
    return np.array(
        [
            max(pair.limit_m, FLESH_SHARE * (thickness[pair.first] + thickness[pair.second]))
            for pair in PAIRS
        ],
        dtype=np.float32,
    )


def solve_self_collisions(
    vertices: np.ndarray,
    parts: BodyParts,
    *,
    gap_m: float,
    limit_m: np.ndarray | None = None,
    cures: Sequence[frozenset[str]] | None = None,
    order: Iterable[int] | None = None,
    suspects: np.ndarray | None = None,
) -> Solution:
    """Separate colliding parts in every frame.

    Args:
        vertices: (N, V, 3) posed body in metres.
        gap_m: between separated parts, 4 mm in CLOTH3D, for two layers of cloth.
        limit_m: (P,) of `depth_limits`; those of the `PAIRS` if None.
        cures: of each of the `PAIRS`, the parts that are left out of all frames if it is too deep
            in one. What has no such parts and is too deep, see `Solution.unsolved`, ends it:
            frames that are not solved yet are left as they are, and others may still hold what
            was left out last. If None, all parts stay and all frames are solved.
        order: in which to solve the frames, each once.
        suspects: (N, P) bool, those of the `PAIRS` that may collide in each frame; all if None.
    """
    pair_parts = np.array(
        [[PART_NAMES.index(pair.first), PART_NAMES.index(pair.second)] for pair in PAIRS]
    )
    rows = vertices.transpose(0, 2, 1)  # see `_contact`
    boxes = np.stack(
        [
            np.stack([rows[:, :, ids].min(axis=2), rows[:, :, ids].max(axis=2)])
            if len(ids)
            else np.stack([np.full((len(vertices), 3), v) for v in (np.inf, -np.inf)])
            for ids in parts.part_vertices
        ],
        axis=2,
    )  # (2, N, parts, 3)
    low = np.maximum(boxes[0][:, pair_parts[:, 0]], boxes[0][:, pair_parts[:, 1]])
    high = np.minimum(boxes[1][:, pair_parts[:, 0]], boxes[1][:, pair_parts[:, 1]])
    meets = (low < high).all(axis=-1)  # (N, P)
    if suspects is not None:
        meets &= suspects
    depth = np.zeros(meets.shape, dtype=np.float32)
    leftover = np.zeros(meets.shape, dtype=bool)
    if limit_m is None:
        limit_m = np.array([pair.limit_m for pair in PAIRS], dtype=np.float32)
    find_inside = InsideParts(parts)
    moves: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    removed: frozenset[str] = frozenset()
    allowed = np.ones(len(PAIRS), dtype=bool)
    waiting = deque(range(len(vertices)) if order is None else map(int, order))
    while waiting:
        frame = waiting.popleft()
        moves.pop(frame, None)
        depth[frame], leftover[frame] = 0, False
        pairs = np.flatnonzero(meets[frame] & allowed)
        if not len(pairs):
            continue
        moved, crossing = _solve_frame(
            vertices[frame], parts, find_inside, pair_parts, pairs, gap_m, depth[frame]
        )
        leftover[frame, crossing] = True
        change = moved - vertices[frame]
        touched = np.flatnonzero(change.any(axis=1))
        moves[frame] = touched, change[touched]
        deep = np.flatnonzero(depth[frame] > limit_m)
        if cures is None or not len(deep):
            continue
        found = frozenset().union(*(cures[pair] for pair in deep))
        if not found:
            around = range(max(frame - 1, 0), min(frame + 2, len(vertices)))
            for other in set(around).intersection(waiting):  # they tell whether it is alone
                waiting.remove(other)
                waiting.appendleft(other)
            known = slice(max(frame - 2, 0), frame + 3)
            if (_too_deep(depth[known], limit_m).any(axis=0) & allowed).any():
                break
            continue
        removed |= found
        allowed = np.array([removed.isdisjoint((pair.first, pair.second)) for pair in PAIRS])
        waiting.appendleft(frame)
        # As well as those in which what is left out from now on has touched something.
        met = (depth > 0) | leftover
        stale = set(np.flatnonzero(met[:, ~allowed].any(axis=1)).tolist())
        waiting.extend(sorted(stale.difference(waiting)))
    frames = sorted(moves)
    return Solution(
        np.repeat(frames, [len(moves[frame][0]) for frame in frames]).astype(np.int32),
        np.concatenate([np.zeros(0), *(moves[frame][0] for frame in frames)]).astype(np.int32),
        np.concatenate([np.zeros((0, 3)), *(moves[frame][1] for frame in frames)]).astype(
            np.float32
        ),
        depth,
        limit_m,
        leftover,
        removed,
    )


def _solve_frame(
    start: np.ndarray,
    parts: BodyParts,
    find_inside: InsideParts,
    pair_parts: np.ndarray,
    pairs: np.ndarray,
    gap_m: float,
    depth: np.ndarray,
) -> tuple[np.ndarray, list[int]]:
    """Moved vertices (V, 3) of one frame and the pairs that still cross; fills `depth` (P,)."""
    vertices = start.copy()
    places = _Places(vertices, parts)
    active = pairs.tolist()
    for turn in range(PASSES + 1):
        # Of the pass's beginning, so that the order of the pairs does not matter.
        before = vertices.copy()
        crossing: list[int] = []
        pressed: set[int] = set()
        members = pair_parts[active].tolist()
        find = partial(_meetings, vertices, before, parts, places, find_inside)
        for pair, both, found in zip(active, members, find(members), strict=True):
            (meeting,) = [found] if pressed.isdisjoint(both) else find([both])
            contact = _contact(vertices, parts, meeting, *both)
            if contact is None:
                continue
            crossing.append(pair)
            if turn < PASSES:
                _separate(vertices, parts, contact, gap_m)
                pressed.update(both)
                places.forget(both)
                moved = np.concatenate(contact.inside)
                reach = np.linalg.norm(vertices[moved] - start[moved], axis=1).max(initial=0)
                depth[pair] = max(depth[pair], reach)
        active = crossing
        if not active:
            break
    return vertices, active


@dataclass(frozen=True)
class _Meeting:
    """Places of two parts that are close."""

    near: tuple[np.ndarray, np.ndarray]  # ids of both parts' vertices in the region where they meet
    # Ids of the first part's vertices inside the second, and the reverse.
    inside: tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class _Contact(_Meeting):
    """Points (k, 3) at which edges of two parts cross faces of the other."""

    points: np.ndarray


def _meetings(
    vertices: np.ndarray,
    before: np.ndarray,
    parts: BodyParts,
    places: "_Places",
    find_inside: InsideParts,
    pair_parts: Sequence[Sequence[int]],
) -> list[_Meeting]:
    """Meetings of the parts of each pair; normals are those of the vertices `before`."""
    near = [places.shared(*pair) for pair in pair_parts]
    questions = []
    for (first, second), (one, other) in zip(pair_parts, near, strict=True):
        questions.append((one[~parts.seam[one, second]], other))
        questions.append((other[~parts.seam[other, first]], one))
    inside = find_inside(vertices, before, questions)
    return [_Meeting(ids, (inside[2 * k], inside[2 * k + 1])) for k, ids in enumerate(near)]


class _Places:
    """Vertices of each part and the box around them, while they stay there."""

    def __init__(self, vertices: np.ndarray, parts: BodyParts) -> None:
        self._vertices, self._parts = vertices, parts
        self._known: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}

    def forget(self, moved: Iterable[int]) -> None:
        """Look at some parts again."""
        for part in moved:
            self._known.pop(part, None)

    def _of(self, part: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        if part not in self._known:
            # Rows of one coordinate each: reducing the short axis of (n, 3) is many times as slow.
            rows = self._vertices[self._parts.part_vertices[part]].T.copy()
            self._known[part] = rows, rows.min(axis=1), rows.max(axis=1)
        return self._known[part]

    def shared(self, first: int, second: int) -> tuple[np.ndarray, np.ndarray]:
        """Ids of the vertices of two parts in the box that both share; none where it is empty."""
        one, other = self._of(first), self._of(second)
        low = np.maximum(one[1], other[1]) - MARGIN_M
        high = np.minimum(one[2], other[2]) + MARGIN_M
        near = [
            self._parts.part_vertices[part][_within(rows, low, high)]
            for part, (rows, *_) in ((first, one), (second, other))
        ]
        if not len(near[0]) or not len(near[1]):
            return near[0][:0], near[1][:0]
        return near[0], near[1]


def _contact(
    vertices: np.ndarray, parts: BodyParts, meeting: _Meeting, first: int, second: int
) -> _Contact | None:
    """Points at which two parts cross, if they do."""
    near, inside = meeting.near, meeting.inside
    if not len(inside[0]) and not len(inside[1]):
        return None
    points = np.concatenate(
        [
            _crossings(vertices, parts, inside[0], first, near[1], second),
            _crossings(vertices, parts, inside[1], second, near[0], first),
        ]
    )
    if len(points) < 3:
        return None
    return _Contact(near, inside, points)


def _within(places: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Mask of the points (3, n) that lie in a box."""
    keep = np.ones(places.shape[1], dtype=bool)
    for axis in range(3):
        keep &= (places[axis] > low[axis]) & (places[axis] < high[axis])
    return keep


def _crossings(
    vertices: np.ndarray,
    parts: BodyParts,
    inside: np.ndarray,
    part: int,
    others: np.ndarray,
    other_part: int,
) -> np.ndarray:
    """(k, 3) points where edges that leave the vertices `inside` cross the other part's faces."""
    edge = _touching(parts.part_edges[part], inside, len(vertices))
    face = _touching(parts.part_faces[other_part], others, len(vertices))
    if not len(edge) or not len(face):
        return np.zeros((0, 3))
    ends, corners = vertices[edge], vertices[face]  # (E, 2, 3), (F, 3, 3)
    edge_boxes, face_boxes = _boxes(ends), _boxes(corners)
    reach = (edge_boxes[0].min(axis=0), edge_boxes[1].max(axis=0))
    close = np.flatnonzero(_meet(face_boxes, reach))
    i, j = np.nonzero(
        _meet([box[:, None] for box in edge_boxes], [box[close] for box in face_boxes])
    )
    j = close[j]
    share = [edge[i, a] == face[j, b] for a in range(2) for b in range(3)]
    apart = ~np.logical_or.reduce(share)
    return segment_triangle_crossings(ends[i[apart]], corners[j[apart]])


def _boxes(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Low and high ends (N, 3) of the boxes around a few corners each (N, k, 3)."""
    # Reducing over an axis this short is many times as slow.
    low = high = corners[:, 0]
    for k in range(1, corners.shape[1]):
        low, high = np.minimum(low, corners[:, k]), np.maximum(high, corners[:, k])
    return low, high


def _meet(first: Sequence[np.ndarray], second: Sequence[np.ndarray]) -> np.ndarray:
    """Whether boxes, each as its low and high end (..., 3), have a point in common."""
    meet = (first[0][..., 0] <= second[1][..., 0]) & (first[1][..., 0] >= second[0][..., 0])
    for axis in (1, 2):
        meet &= first[0][..., axis] <= second[1][..., axis]
        meet &= first[1][..., axis] >= second[0][..., axis]
    return meet


def _touching(elements: np.ndarray, ids: np.ndarray, count: int) -> np.ndarray:
    """Those edges or faces that have at least one of the vertices."""
    chosen = np.zeros(count, dtype=bool)
    chosen[ids] = True
    keep = chosen[elements[:, 0]]
    for column in elements.T[1:]:
        keep = keep | chosen[column]
    return elements[keep]


def segment_triangle_crossings(segments: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Crossing points (k, 3) of segments (M, 2, 3) with triangles (M, 3, 3), row by row."""
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    corner = triangles[:, 0]
    side_a, side_b = triangles[:, 1] - corner, triangles[:, 2] - corner
    p = cross_rows(along, side_b)
    scale = np.einsum("mi,mi->m", side_a, p)
    flat = np.abs(scale) < 1e-14
    scale = np.where(flat, 1.0, scale)
    offset = start - corner
    u = np.einsum("mi,mi->m", offset, p) / scale
    q = cross_rows(offset, side_a)
    v = np.einsum("mi,mi->m", along, q) / scale
    t = np.einsum("mi,mi->m", side_b, q) / scale
    hit = ~flat & (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t <= 1)
    return start[hit] + t[hit, None] * along[hit]


def _separate(vertices: np.ndarray, parts: BodyParts, contact: _Contact, gap_m: float) -> None:
    """Move both parts' vertices, in place, to their own sides of one plane per contact."""
    for points in _clusters(contact.points):
        centre = points.mean(axis=0)
        normal = np.linalg.svd(points - centre, full_matrices=False)[2][2]
        radius = np.linalg.norm(points - centre, axis=1).max() + 0.01
        heights = [
            (vertices[_within_reach(vertices, ids, centre, radius)] - centre) @ normal
            for ids in contact.inside
        ]
        # What is inside the other part is beyond the plane.
        if heights[0].sum() > heights[1].sum():
            normal = -normal
        for side, sign in ((0, 1.0), (1, -1.0)):
            # Two rings more: what does not cross yet may be closer than the gap.
            reached = parts.around(parts.around(contact.inside[side]))
            ids = np.intersect1d(contact.near[side], reached, assume_unique=True)
            ids = _within_reach(vertices, ids, centre, radius)
            height = sign * ((vertices[ids] - centre) @ normal)
            lacking = np.maximum(gap_m / 2 - height, 0)
            vertices[ids] += (sign * lacking)[:, None] * normal


def _clusters(points: np.ndarray) -> list[np.ndarray]:
    """Connected groups of at least three points."""
    # There are tens of points: a k-d tree and a sparse graph take several times as long.
    linked = ((points[:, None] - points) ** 2).sum(axis=-1) <= LINK_M**2
    waiting = np.ones(len(points), dtype=bool)
    groups = []
    while waiting.any():
        group = linked[waiting.argmax()]
        while (grown := linked[group].any(axis=0)).sum() > group.sum():
            group = grown
        groups.append(points[group])
        waiting &= ~group
    return [group for group in groups if len(group) >= 3]


def _within_reach(
    vertices: np.ndarray, ids: np.ndarray, centre: np.ndarray, radius: float
) -> np.ndarray:
    """Those of some vertices that are less than a radius away from a point."""
    return ids[np.linalg.norm(vertices[ids] - centre, axis=1) < radius]
