"""The two topologies of the super-resolved body: legs apart, and in one tube (CLOTH3D 4.1)."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated

import numpy as np
from scipy.sparse import csr_matrix, eye_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu
from scipy.spatial import ConvexHull

from drapeline.bodies.model import posed_vertices
from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES, REST_POSE
from drapeline.geometry.mesh import boundary_loops, edge_counts, edges
from drapeline.geometry.smoothing import averaging_matrix
from drapeline.outfits.garment_types import GARMENTS, SKIRTS
from drapeline.registration.to_body.segments import garment_variability, segment_body
from drapeline.registration.to_body.super_body import SuperBody
from drapeline.storage import load_record, save_record

# Vertices that lie this deep below the hull around both legs belong to their inner sides.
INNER_DEPTH_M = 0.004
_SLICE_M = 0.02
BOUNDARIES = 4  # a neck, two wrists, the hem around both ankles
# On rough meshes the line may touch itself: then lines a little in front or behind are tried.
_SHIFTS_M = (0.0, 0.002, -0.002, 0.004, -0.004, 0.006, -0.006, 0.009, -0.009, 0.012, -0.012)


@dataclass(frozen=True)
class SkirtTopology:
    """The second topology."""

    faces: np.ndarray  # (F2, 3) int32; the last `added` of them are new
    added: int  # number of new faces
    removed: np.ndarray  # (R,) ids of the first topology's faces that are left out
    inner_leg: np.ndarray  # (V,) bool, vertices that smoothing moves


def skirt_topology(rest: np.ndarray, faces: np.ndarray, hips: float) -> SkirtTopology:
    """Join the legs of a body.

    Args:
        rest: (V, 3) metres, in the rest pose, Z up, facing -Y.
        faces: (F, 3) with five boundaries: neck, wrists, ankles.
        hips: height of the hip joints; the inner sides end below.

    Raises:
        ValueError: no strip of faces leads from one ankle to the other.
    """
    levels = _levels(rest, faces, hips)
    ahead = _ahead(rest, faces, levels)
    failure = ValueError()
    for shift in _SHIFTS_M:
        try:
            joined, strip, chains = _join_legs(rest, faces, ahead > shift, hips)
        except ValueError as error:
            failure = error
        else:
            added = len(joined) - len(faces) + len(strip)
            return SkirtTopology(
                joined, added, strip, _inner_leg(rest, faces, joined, chains, levels)
            )
    raise failure


class Smoother:
    """Laplacian smoothing of some vertices with the others fixed, to convergence.

    Moving each vertex to the mean of its neighbours again and again ends where all of them lie
    there already: a sparse linear system, which is solved at once. Neighbours of vertices on a
    boundary are those along it, so that a hem stays a line.

    Args:
        faces: (F, 3).
        moved: (V,) bool, the vertices to smooth.
    """

    def __init__(self, faces: np.ndarray, moved: np.ndarray) -> None:
        self._moved, self._fixed = np.flatnonzero(moved), np.flatnonzero(~moved)
        mean = averaging_matrix(faces, len(moved), along_boundaries=True)[self._moved]
        mean.sort_indices()  # a fixed order of summation, however the matrix was made
        self._pull = mean[:, self._fixed]
        self._solve = splu((eye_array(len(self._moved)) - mean[:, self._moved]).tocsc()).solve

    def __call__(self, vertices: np.ndarray) -> np.ndarray:
        """Smooth vertices (V, 3)."""
        out = np.array(vertices)
        out[self._moved] = self._solve(self._pull @ vertices[self._fixed].astype(np.float64))
        return out


def _ankles(rest: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Boundary loops of the left and of the right ankle."""
    loops = sorted(boundary_loops(faces), key=lambda loop: rest[loop, 2].mean())[:2]
    right, left = sorted(loops, key=lambda loop: rest[loop, 0].mean())
    return left, right


def _section(rest: np.ndarray, pairs: np.ndarray, height: float) -> np.ndarray:
    """(P, 2) places where edges cross a horizontal plane."""
    z = rest[pairs, 2] - height
    crossing = pairs[(z[:, 0] > 0) != (z[:, 1] > 0)]
    a, b = rest[crossing[:, 0]], rest[crossing[:, 1]]
    share = (height - a[:, 2]) / (b[:, 2] - a[:, 2])
    return (a + share[:, None] * (b - a))[:, :2]


def _levels(rest: np.ndarray, faces: np.ndarray, top: float) -> np.ndarray:
    """Heights of sections through both legs, from above the ankles' boundaries to `top`."""
    bottom = max(rest[loop, 2].max() for loop in _ankles(rest, faces)) + 1e-4
    return np.linspace(bottom, top, max(4, round((top - bottom) / _SLICE_M)))


def _join_legs(
    rest: np.ndarray, faces: np.ndarray, before: np.ndarray, hips: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The second topology's faces, ids of the faces left out, and the vertices along these."""
    strip, *chains = _strip(rest, faces, before, hips)
    kept = np.delete(faces, strip, axis=0)
    used = {tuple(pair) for pair in edges(kept).tolist()}
    added = [triangle for chain in chains for triangle in _zip_chain(rest, kept, chain, used)]
    joined = np.concatenate([kept, np.array(added)]).astype(np.int32)
    if len(boundary_loops(joined)) != BOUNDARIES or edge_counts(joined)[1].max() > 2:
        raise ValueError("the legs do not make one tube")
    return joined, np.sort(strip), np.concatenate(chains)


def _strip(
    rest: np.ndarray, faces: np.ndarray, before: np.ndarray, hips: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The faces along the legs' inner-most lines, from the left ankle to the right one.

    Args:
        before: (V,) whether a vertex lies in front of that line.

    Returns:
        Their ids, and the chains of vertices before and behind them, both from left to right.
    """
    left, right = (set(loop.tolist()) for loop in _ankles(rest, faces))
    mixed = before[faces].any(axis=1) & ~before[faces].all(axis=1)
    ways: dict[tuple[int, int], list[int]] = {}  # edges across the line, and their faces
    for face in np.flatnonzero(mixed & (rest[faces, 2] < hips).all(axis=1)).tolist():
        for pair in _pairs(faces[face].tolist()):
            if before[pair[0]] != before[pair[1]]:
                ways.setdefault(pair, []).append(face)
    for start, owners in ways.items():
        if len(owners) == 1 and set(start) <= left:
            strip, crossed = _follow_strip(start, ways)
            if set(crossed[-1]) <= right:
                front, back = (
                    _chain([next(v for v in pair if before[v] == side) for pair in crossed])
                    for side in (True, False)
                )
                return np.array(strip), front, back
    raise ValueError("no strip of faces leads along the inner legs from one ankle to the other")


def _ahead(rest: np.ndarray, faces: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """(V,) metres by which a vertex lies in front of the middle of the legs at its height."""
    pairs = edges(faces)
    extent = [_section(rest, pairs, z)[:, 1] for z in levels]
    middle = np.array([(y.min() + y.max()) / 2 for y in extent])
    middle = np.convolve(np.pad(middle, 3, mode="edge"), np.ones(7) / 7, mode="valid")
    return np.interp(rest[:, 2], levels, middle) - rest[:, 1]


def _pairs(corners: list[int]) -> list[tuple[int, int]]:
    a, b, c = sorted(corners)
    return [(a, b), (b, c), (a, c)]


def _follow_strip(
    way: tuple[int, int], ways: dict[tuple[int, int], list[int]]
) -> tuple[list[int], list[tuple[int, int]]]:
    """Faces and the edges between them in order, from an edge on the boundary on to its end."""
    of_face: dict[int, list[tuple[int, int]]] = {}
    for pair, owners in ways.items():
        for face in owners:
            of_face.setdefault(face, []).append(pair)
    strip: list[int] = []
    crossed = [way]
    while onward := [f for f in ways[way] if f not in strip[-1:]]:
        strip.append(onward[0])
        (way,) = (pair for pair in of_face[strip[-1]] if pair != way)
        crossed.append(way)
    return strip, crossed


def _chain(visited: list[int]) -> np.ndarray:
    """Vertices in order, each once."""
    chain = [v for k, v in enumerate(visited) if k == 0 or v != visited[k - 1]]
    if len(set(chain)) < len(chain):
        raise ValueError("the line along the inner legs touches itself")
    return np.array(chain)


def _zip_chain(
    rest: np.ndarray, faces: np.ndarray, chain: np.ndarray, used: set[tuple[int, int]]
) -> list[list[int]]:
    """Triangles between the two halves of a chain, from its ends at the ankles to its middle.

    Of the two triangles that may come next, the one whose new edge is more level is taken; taking
    the shorter edge would lead to fans. `used` are the edges of the mesh; new ones are added.
    """
    half = {pair for k in range(3) for pair in zip(faces[:, k - 1], faces[:, k], strict=True)}
    forward = (chain[0], chain[1]) in half
    out: list[list[int]] = []
    i, j, one_more_left = 0, len(chain) - 1, True
    used.add(_key(chain[i], chain[j]))
    while j - i > 1:
        steps = []
        for left in (one_more_left, not one_more_left):
            a, b = (chain[i + 1], chain[j]) if left else (chain[i], chain[j - 1])
            last = j - i == 2  # closes with an edge of the chain itself
            if last or _key(a, b) not in used:
                steps.append((round(abs(float(rest[a, 2] - rest[b, 2])), 9), left))
        if not steps:
            raise ValueError("the legs cannot be joined: all edges across are taken")
        left = min(steps, key=lambda step: step[0])[1]
        corners = [chain[i], chain[i + 1] if left else chain[j - 1], chain[j]]
        out.append([int(v) for v in (corners[::-1] if forward else corners)])
        i, j = (i + 1, j) if left else (i, j - 1)
        used.add(_key(chain[i], chain[j]))
        one_more_left = not left
    return out


def _key(a: int, b: int) -> tuple[int, int]:
    return (int(min(a, b)), int(max(a, b)))


def _inner_leg(
    rest: np.ndarray, faces: np.ndarray, joined: np.ndarray, chains: np.ndarray, levels: np.ndarray
) -> np.ndarray:
    """(V,) vertices of the inner sides: deep below the hull around both legs, in one piece."""
    pairs = edges(faces)
    deep = np.zeros(len(rest), dtype=bool)
    below = np.flatnonzero(rest[:, 2] < levels[-1])
    nearest = np.abs(rest[below, 2, None] - levels).argmin(axis=1)
    for index, level in enumerate(levels):
        here = below[nearest == index]
        walls = ConvexHull(_section(rest, pairs, level)).equations  # outward normals, offsets
        depth = -(rest[here, :2] @ walls[:, :2].T + walls[:, 2]).max(axis=1)
        deep[here] = depth > INNER_DEPTH_M
    pairs = edges(joined)
    deep[chains] = True
    inner = pairs[deep[pairs].all(axis=1)]
    graph = csr_matrix((np.ones(len(inner)), inner.T), shape=(len(rest),) * 2)
    _, label = connected_components(graph, directed=False)
    deep &= np.isin(label, label[chains])
    return _without_islands(deep, pairs)


def _without_islands(moved: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Let vertices that only moved ones surround move as well: (V,) bool."""
    both = np.concatenate([pairs, pairs[:, ::-1]])
    fixed = np.bincount(both[:, 0], ~moved[both[:, 1]], len(moved))
    return moved | (fixed == 0)


TOPOLOGIES = ("body", "skirt")  # index = code of a topology


def topology_codes(garments: np.ndarray) -> np.ndarray:
    """(N,) indices into `GARMENTS` -> (N,) int64 indices into `TOPOLOGIES`."""
    return np.array([name in SKIRTS for name in GARMENTS], dtype=np.int64)[garments]


@dataclass(frozen=True)
class Topology:
    """Meshes on V vertices."""

    faces: Annotated[np.ndarray, "int<v * 3"]  # the body's own
    skirt_faces: Annotated[np.ndarray, "int<v * 3"]  # legs joined
    joining: Annotated[np.ndarray, "int"]  # how many of these, the last ones, are new
    inner_leg: Annotated[np.ndarray, "bool v"]  # vertices that are smoothed for skirts
    segments: Annotated[np.ndarray, "int v"]  # 0 to 20
    # Places on the mesh of the body's file, for carrying further arrays over; see
    # `super_body.interpolation`.
    corners: Annotated[np.ndarray, "int v 3"]
    shares: Annotated[np.ndarray, "float v 3"]
    rest: Annotated[np.ndarray, "float v 3"]  # mean of both genders in the rest pose, metres

    def faces_of(self, garment: str) -> np.ndarray:
        """(F, 3) faces to use with a garment's type."""
        return self.skirt_faces if garment in SKIRTS else self.faces

    @cached_property
    def smoother(self) -> Smoother:
        """Smoothing of the inner legs."""
        return Smoother(self.skirt_faces, self.inner_leg)


def build_topology(body: SuperBody) -> Topology:
    """Derive both topologies and the segments from the bodies' mean in the rest pose.

    Raises:
        InputError: the legs cannot be joined.
    """
    posed = [posed_vertices(b, np.zeros(10), REST_POSE[None]) for b in body.bodies.values()]
    rest = np.mean([vertices[0] for vertices, _ in posed], axis=0).astype(np.float64)
    joints = np.mean([places[0] for _, places in posed], axis=0)
    hips = float(joints[[JOINT_NAMES.index(f"{s}_hip") for s in ("left", "right")], 2].mean())
    try:
        skirt = skirt_topology(rest, body.faces, hips)
    except ValueError as error:
        names = " and ".join(b.name for b in body.bodies.values())
        raise InputError(f"{names}: {error}, expected two legs apart") from error
    variability = garment_variability(rest, joints)
    return Topology(
        faces=body.faces,
        skirt_faces=skirt.faces,
        joining=np.array(skirt.added, dtype=np.int32),
        inner_leg=skirt.inner_leg,
        segments=segment_body(rest, body.faces, skirt.faces, variability),
        corners=body.corners,
        shares=body.shares,
        rest=rest.astype(np.float32),
    )


def skirt_body(topology: Topology, vertices: np.ndarray) -> np.ndarray:
    """Smooth the inner legs of a body in the rest pose, for skirts and dresses.

    Args:
        topology: of the body.
        vertices: (V, 3) of any shape.

    Returns:
        (V, 3) of the same type: vertices outside `inner_leg` unchanged.
    """
    return topology.smoother(vertices)


def save_topology(path: str | Path, topology: Topology) -> None:
    """Write a topology as `.npz`."""
    save_record(path, topology)


def load_topology(path: str | Path) -> Topology:
    """Read a topology.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    return load_record(path, Topology)
