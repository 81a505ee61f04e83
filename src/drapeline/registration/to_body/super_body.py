"""The super-resolved body: no head, hands or feet, and refined to a fixed number of vertices.

CLOTH3D section 4.1 subdivides SMPL, interpolates its parameters and takes off what garments do
not cover, which leaves 14,475 vertices. Here planes cut the body at neck, wrists and ankles, and
the longest edge is halved until the mesh has the wanted number of vertices: edges get similar
lengths, and every body file the same count. Every vertex lies in a triangle of the file's mesh, so
that each of the file's parameters follows by one linear interpolation.
"""

import heapq
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from drapeline.bodies.model import BodyModel
from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES
from drapeline.geometry.mesh import boundary_loops, edge_counts, edge_graph, edge_lengths, edges

VERTICES = 14475
BOUNDARIES = 5  # a neck, two wrists, two ankles
# Each cut's plane: the two joints of its bone, where on the bone it stands (1 is the second
# joint), and the joints whose parts are cut off. Long sleeves end at the wrist and long legs at
# the ankle; sleeves that are loose slide over the wrist, so that cut stands a little past it.
_CUTS = (
    ("neck", "head", 0.5, ("head",)),
    ("left_elbow", "left_wrist", 1.05, ("left_wrist", "left_hand")),
    ("right_elbow", "right_wrist", 1.05, ("right_wrist", "right_hand")),
    ("left_knee", "left_ankle", 1.0, ("left_ankle", "left_foot")),
    ("right_knee", "right_ankle", 1.0, ("right_ankle", "right_foot")),
)
# A vertex this near to a plane, in edge lengths, counts as lying on it: fewer slivers. Where that
# would pinch a boundary the next, smaller value is tried.
_SNAPS = (0.2, 0.1, 0.0)
_SYMMETRY_M = 1e-6


@dataclass(frozen=True)
class SuperBody:
    """Refined bodies of one surface."""

    bodies: dict[str, BodyModel]  # gender -> model of V vertices, all with the same faces
    # (V, 3) int32, vertices of the file's mesh between which each vertex lies; one of them again
    # where it lies on an edge or in a corner.
    corners: np.ndarray
    shares: np.ndarray  # (V, 3) float64, its barycentric coordinates there
    # (V,) vertex on the other side, or None where the mesh is not symmetric.
    mirror: np.ndarray | None

    @property
    def faces(self) -> np.ndarray:
        """(F, 3) int32."""
        return next(iter(self.bodies.values())).faces


def build_super_body(bodies: Mapping[str, BodyModel], vertices: int = VERTICES) -> SuperBody:
    """Cut and refine the bodies of all genders alike.

    Args:
        bodies: gender -> body; all have one mesh.
        vertices: number wanted; 0 leaves the cut body unrefined.

    Raises:
        InputError: the meshes differ, a part cannot be cut off with one boundary, or the cut body
            has more vertices than wanted.
    """
    first = next(iter(bodies.values()))
    for body in bodies.values():
        if not np.array_equal(body.faces, first.faces):
            raise InputError(
                f"body {body.name}: its faces differ from those of {first.name},"
                " expected the same mesh for both genders"
            )
    template = np.mean([b.v_template.astype(np.float64) for b in bodies.values()], axis=0)
    joints = np.mean([b.J_regressor @ b.v_template for b in bodies.values()], axis=0)
    surface = _cut_off(template, joints, first)
    if vertices:
        if len(surface.points) > vertices:
            raise InputError(
                f"body {first.name}: has {len(surface.points)} vertices without head, hands and"
                f" feet, expected at most the {vertices} asked for (0 leaves them as they are)"
            )
        surface = _refine(surface, vertices)
    faces = np.array(surface.faces, dtype=np.int32)
    corners, shares = _places(surface.sources)
    owner = np.array(surface.owners)
    return SuperBody(
        {g: _carry_over(b, faces, owner, corners, shares) for g, b in bodies.items()},
        corners,
        shares,
        mirror_of(np.array(surface.points), faces),
    )


def mirror_of(points: np.ndarray, faces: np.ndarray) -> np.ndarray | None:
    """Ids (V,) of the vertices on the other side of x = 0; None if the mesh is not symmetric.

    A mesh with faces across x = 0 counts as not symmetric: refining cannot keep it so.
    """
    distance, mirror = KDTree(points).query(points * [-1, 1, 1])
    if distance.max() > _SYMMETRY_M or not np.array_equal(mirror[mirror], np.arange(len(points))):
        return None
    across = points[:, 0][faces]
    if ((across.max(axis=1) > _SYMMETRY_M) & (across.min(axis=1) < -_SYMMETRY_M)).any():
        return None
    here, there = (
        {tuple(face) for face in _start_at_smallest(f).tolist()}
        for f in (faces, mirror[faces][:, ::-1])
    )
    return mirror if here == there else None


def interpolation(corners: np.ndarray, shares: np.ndarray, count: int) -> csr_matrix:
    """Matrix (V, count) from values on the file's vertices to those on a `SuperBody`'s."""
    rows = np.arange(len(corners)).repeat(3)
    return csr_matrix((shares.ravel(), (rows, corners.ravel())), shape=(len(corners), count))


@dataclass
class _RefinedMesh:
    """A mesh under work, in lists since it grows by single vertices."""

    points: list[list[float]]  # V places, metres
    sources: list[dict[int, float]]  # V tables, vertex of the file -> share
    faces: list[list[int]]  # F corners
    owners: list[int]  # F ids of the file's triangle that each face is a piece of


def _start_at_smallest(faces: np.ndarray) -> np.ndarray:
    """The same faces, each beginning with its smallest id."""
    start = faces.argmin(axis=1)[:, None]
    return np.take_along_axis(faces, (start + np.arange(3)) % 3, axis=1)


def _cut_off(template: np.ndarray, joints: np.ndarray, body: BodyModel) -> _RefinedMesh:
    mirror = mirror_of(template, body.faces)
    count = 0
    for snap in _SNAPS:
        height = _heights(template, joints, body, mirror, snap)
        surface = _slice(template, body.faces, height)
        faces = np.array(surface.faces)
        try:
            count = len(boundary_loops(faces))
        except ValueError:
            continue
        if count == BOUNDARIES and _is_one_surface(faces, len(surface.points)):
            return surface
    raise InputError(
        f"body {body.name}: cutting off head, hands and feet leaves {count} boundaries or loose"
        f" pieces, expected one piece with {BOUNDARIES} boundaries"
    )


def _is_one_surface(faces: np.ndarray, count: int) -> bool:
    pairs, sides = edge_counts(faces)
    return sides.max() == 2 and _component_count(pairs, count) == 1


def _component_count(pairs: np.ndarray, count: int) -> int:
    return connected_components(edge_graph(pairs, count), directed=False)[0]


def _heights(
    template: np.ndarray,
    joints: np.ndarray,
    body: BodyModel,
    mirror: np.ndarray | None,
    snap: float,
) -> np.ndarray:
    """(V,) metres past the nearest cut's plane; -inf far from all of them."""
    count = len(template)
    pairs = edges(body.faces)
    lengths = edge_lengths(template, pairs)
    both = np.concatenate([pairs, pairs[:, ::-1]])
    mean_length: np.ndarray = np.bincount(both[:, 0], np.tile(lengths, 2), count)
    mean_length /= np.maximum(np.bincount(both[:, 0], minlength=count), 1)
    out = np.full(count, -np.inf)
    for start, end, place, parts in _CUTS:
        a, b = joints[JOINT_NAMES.index(start)], joints[JOINT_NAMES.index(end)]
        height = (template - a - place * (b - a)) @ (b - a) / np.linalg.norm(b - a)
        height[np.abs(height) < snap * mean_length] = 0
        past = height > 0
        inner = pairs[past[pairs].all(axis=1)]
        _, label = connected_components(edge_graph(inner, count), directed=False)
        wanted = past & np.isin(body.segmentation, [JOINT_NAMES.index(p) for p in parts])
        if not wanted.any():
            raise InputError(f"body {body.name}: has no vertices past {end}, nothing to cut off")
        part = past & (label == np.bincount(label[wanted]).argmax())
        ring = both[part[both[:, 0]], 1]
        near = np.concatenate([np.flatnonzero(part), ring[~past[ring]]])
        out[near] = np.maximum(out[near], height[near])
    if mirror is not None:
        # Joints regressed in single precision are not symmetric to the last digit.
        middle = (out + out[mirror]) / 2
        out = np.where(np.sign(out) == np.sign(out[mirror]), middle, 0.0)
    return out


def _slice(points: np.ndarray, faces: np.ndarray, height: np.ndarray) -> _RefinedMesh:
    """The part of the mesh with negative height, with new vertices where edges cross zero."""
    surface = _RefinedMesh([], [], [], [])
    ids: dict[tuple[int, ...], int] = {}

    def vertex(key: tuple[int, ...], sources: dict[int, float]) -> int:
        if key not in ids:
            ids[key] = len(surface.points)
            surface.points.append(sum(s * points[v] for v, s in sources.items()).tolist())
            surface.sources.append(sources)
        return ids[key]

    def crossing(a: int, b: int) -> int:
        a, b = sorted((a, b))
        share = float(height[a] / (height[a] - height[b]))
        return vertex((a, b), {a: 1 - share, b: share})

    signs = np.sign(height)
    for index in np.flatnonzero((signs[faces] < 0).any(axis=1)).tolist():
        polygon: list[int] = []
        corners = faces[index].tolist()
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            if signs[a] <= 0:
                polygon.append(vertex((a,), {a: 1.0}))
            if signs[a] * signs[b] < 0:
                polygon.append(crossing(a, b))
        if len(polygon) == 4:
            p = [np.array(surface.points[v]) for v in polygon]
            if np.linalg.norm(p[0] - p[2]) > np.linalg.norm(p[1] - p[3]):
                polygon = polygon[1:] + polygon[:1]
        for k in range(1, len(polygon) - 1):
            surface.faces.append([polygon[0], polygon[k], polygon[k + 1]])
            surface.owners.append(index)
    return surface


def _refine(surface: _RefinedMesh, vertices: int) -> _RefinedMesh:
    """Halve the longest edge again and again, and its mirror image with it."""
    points, faces = surface.points, surface.faces
    mirror = mirror_of(np.array(points), np.array(faces))
    other = None if mirror is None else mirror.tolist()
    sides: dict[tuple[int, int], list[int]] = {}
    for index, (a, b, c) in enumerate(faces):
        for pair in ((a, b), (b, c), (c, a)):
            sides.setdefault(_key(*pair), []).append(index)
    queue = [_rank(points, pair) for pair in sides]
    heapq.heapify(queue)
    while len(points) < vertices:
        if not queue:
            raise InputError(
                f"{vertices} vertices cannot be reached on both sides alike,"
                f" expected {vertices + 1}"
            )
        rank = heapq.heappop(queue)
        pair = rank[1]
        if pair not in sides:
            continue  # halved already, as a mirror image
        twin = pair if other is None else _key(other[pair[0]], other[pair[1]])
        if twin != pair and len(points) + 2 > vertices:
            continue  # one vertex is left to place: it goes on the plane of symmetry
        middle = _halve(surface, sides, queue, pair)
        if other is not None:
            twin_middle = middle if twin == pair else _halve(surface, sides, queue, twin)
            other += [twin_middle] if twin == pair else [twin_middle, middle]
    return surface


def _key(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)


def _rank(points: list[list[float]], pair: tuple[int, int]) -> tuple[float, tuple[int, int]]:
    """Key that sorts the longest edge first; rounded, so that equal edges are ordered by ids."""
    a, b = points[pair[0]], points[pair[1]]
    square = (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
    return -round(square, 12), pair


def _halve(
    surface: _RefinedMesh,
    sides: dict[tuple[int, int], list[int]],
    queue: list[tuple[float, tuple[int, int]]],
    pair: tuple[int, int],
) -> int:
    """Put a vertex in the middle of an edge and join it to the corners opposite."""
    points, sources, faces = surface.points, surface.sources, surface.faces
    a, b = pair
    middle = len(points)
    points.append([(p + q) / 2 for p, q in zip(points[a], points[b], strict=True)])
    mixed = {v: s / 2 for v, s in sources[a].items()}
    for v, s in sources[b].items():
        mixed[v] = mixed.get(v, 0.0) + s / 2
    sources.append(mixed)
    fresh = [_key(a, middle), _key(b, middle)]
    for key in fresh:
        sides[key] = []
    for face in sides.pop(pair):
        corners = faces[face]
        (tip,) = (c for c in corners if c != a and c != b)
        added = len(faces)
        faces.append([middle if c == a else c for c in corners])
        surface.owners.append(surface.owners[face])
        faces[face] = [middle if c == b else c for c in corners]
        far = sides[_key(b, tip)]
        far[far.index(face)] = added
        sides[_key(middle, tip)] = [face, added]
        sides[fresh[0]].append(face)
        sides[fresh[1]].append(added)
        fresh.append(_key(middle, tip))
    for key in fresh:
        heapq.heappush(queue, _rank(points, key))
    return middle


def _places(sources: Iterable[dict[int, float]]) -> tuple[np.ndarray, np.ndarray]:
    """Tables of shares as arrays: corners (V, 3) int32 and shares (V, 3)."""
    rows = [[*sorted(table.items()), *[(min(table), 0.0)] * (3 - len(table))] for table in sources]
    both = np.array(rows)  # (V, 3, 2)
    return both[..., 0].astype(np.int32), both[..., 1]


def _carry_over(
    body: BodyModel, faces: np.ndarray, owner: np.ndarray, corners: np.ndarray, shares: np.ndarray
) -> BodyModel:
    """Carry a body model over to the refined surface."""
    count = len(body.v_template)
    matrix = interpolation(corners, shares, count)

    def carry(values: np.ndarray) -> np.ndarray:
        return (matrix @ values.reshape(count, -1)).reshape(len(corners), *values.shape[1:])

    weights = carry(body.weights)
    carried = replace(
        body,
        v_template=carry(body.v_template).astype(np.float32),
        shapedirs=carry(body.shapedirs).astype(np.float32),
        posedirs=carry(body.posedirs).astype(np.float32),
        weights=(weights / weights.sum(axis=1, keepdims=True)).astype(np.float32),
        faces=faces,
        segmentation=body.segmentation[_heaviest(corners, shares)],
        name=f"{body.name}-super-{len(corners)}",
    )
    vt, ft = _texture(body, faces, owner, corners, shares)
    regressor = _regressor(body, carried, corners, shares)
    return replace(carried, vt=vt, ft=ft, J_regressor=regressor)


def _heaviest(corners: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """(V,) vertex of the file with the largest share."""
    return np.take_along_axis(corners, shares.argmax(axis=1)[:, None], axis=1)[:, 0]


def _regressor(
    body: BodyModel, carried: BodyModel, corners: np.ndarray, shares: np.ndarray
) -> np.ndarray:
    """(24, V) that gives the whole body's joints for every shape.

    A joint is linear in 34 numbers of its row: the row's sum, and the joint of the template and of
    ten shapes. The row's entries on the remaining vertices are changed as little as possible (in
    the sum of squares) to bring these numbers back to those of the whole body.
    """

    def system(model: BodyModel) -> np.ndarray:
        columns = [np.ones((len(model.v_template), 1)), model.v_template]
        columns.append(model.shapedirs.reshape(len(model.v_template), -1))
        return np.concatenate(columns, axis=1).astype(np.float64)  # (V, 34)

    kept = np.flatnonzero(shares.max(axis=1) == 1)
    rows = np.zeros((24, len(corners)))
    rows[:, kept] = body.J_regressor[:, _heaviest(corners, shares)[kept]]
    basis = system(carried)
    missing = body.J_regressor.astype(np.float64) @ system(body) - rows @ basis  # (24, 34)
    # lstsq's solution of an underdetermined system is the one of least norm.
    change = np.linalg.lstsq(basis.T, missing.T, rcond=1e-12)[0]  # (V, 24)
    return (rows + change.T).astype(np.float32)


def _texture(
    body: BodyModel, faces: np.ndarray, owner: np.ndarray, corners: np.ndarray, shares: np.ndarray
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Texture coordinates; a vertex on a seam has one for each side, as in the file."""
    if body.vt is None or body.ft is None:
        return None, None
    places, part = corners[faces], shares[faces]  # (F, 3, 3): face, its corner, that one's source
    same = places[..., None] == body.faces[owner][:, None, None, :]  # (F, 3, 3, 3)
    share = (part[..., None] * same).sum(axis=2)  # (F, 3, 3): of each corner of the file's triangle
    sources = body.ft[owner][:, None, :]
    uv = (share[..., None] * body.vt[sources]).sum(axis=2)  # (F, 3, 2)
    # Corners of one vertex are one texture vertex where they come from the same ones of the file.
    named = np.sort(np.where(share > 0, sources, -1), axis=2)
    key = np.concatenate([faces[..., None], named], axis=2).reshape(-1, 4)
    _, first, ft = np.unique(key, axis=0, return_index=True, return_inverse=True)
    vt = uv.reshape(-1, 2)[first]
    return vt.astype(np.float32), ft.reshape(-1, 3).astype(np.int32)
