"""Meshes of fewer and fewer vertices for pooling (CLOTH3D 4.2, figure 6).

Edges contract in the order of their cost until a level has as many vertices as it should. The
cost of contracting an edge is Garland and Heckbert's quadric error of the vertex that is left,
plus a term for the edge's length that keeps vertices evenly spread, as in Yuan et al., "Mesh
variational autoencoders with edge contraction pooling". With segments, edges between two of them
never contract, and the last level has one vertex for each.
"""

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from drapeline.errors import InputError
from drapeline.geometry.mesh import edge_counts, edges
from drapeline.registration.to_body.segments import SEGMENTS, vertex_areas
from drapeline.registration.to_body.topology import TOPOLOGIES, Topology, skirt_body
from drapeline.storage import load_npz, save_npz

POOLINGS = ("segments", "uniform")
LEVELS = 6
_BEFORE_LAST = 56
# Weight of the length's term. Both terms are squared metres of distance times square metres of
# surface; at 1 the quadric error would hardly count.
_SPREAD = 0.1


@dataclass(frozen=True)
class Hierarchy:
    """Pooling tables, by topology ("body", "skirt") and then by level, the finest first."""

    # Five tables (n_l,) int32, vertex of the next level that each becomes part of.
    parents: dict[str, list[np.ndarray]]
    # Six tables (E_l, 2) int32 with i < j; the following are six tables too.
    edges: dict[str, list[np.ndarray]]
    positions: dict[str, list[np.ndarray]]  # (n_l, 3) float32 metres, in the rest pose
    vertices: dict[str, list[np.ndarray]]  # (n_l,) int32, vertex of the body that stands for each

    @property
    def counts(self) -> tuple[int, ...]:
        """Vertices of each level."""
        return tuple(len(p) for p in self.positions[TOPOLOGIES[0]])

    def labels(self, topology: str, level: int) -> np.ndarray:
        """(V,) vertex of a level that each of the body's vertices becomes part of."""
        label = np.arange(self.counts[0])
        for parent in self.parents[topology][:level]:
            label = parent[label]
        return label


def level_counts(vertices: int) -> tuple[int, ...]:
    """Vertices of each level: about equal ratios from a body's own count down to 56, then 21.

    For 14,475 these are the paper's: 14475, 3618, 904, 226, 56, 21.

    Raises:
        InputError: the body has too few vertices.
    """
    if vertices < 2 * _BEFORE_LAST:
        raise InputError(
            f"a body of {vertices} vertices, expected at least {2 * _BEFORE_LAST} for a hierarchy"
        )
    steps = LEVELS - 2
    quarters = [vertices // 4**level for level in range(steps + 1)]
    if quarters[-1] == _BEFORE_LAST:
        return (*quarters, SEGMENTS)
    ratio = (vertices / _BEFORE_LAST) ** (1 / steps)
    return (*(round(vertices / ratio**level) for level in range(steps + 1)), SEGMENTS)


def build_hierarchy(topology: Topology, pooling: str, counts: Sequence[int]) -> Hierarchy:
    """Coarsen both topologies.

    Args:
        pooling: "segments", or "uniform" for contraction across segments too.
        counts: vertices of each level, the first those of the body; see `level_counts`. The last
            is `SEGMENTS`.

    Raises:
        ValueError: an unknown pooling, or counts that are not these.
    """
    rest = topology.rest.astype(np.float64)
    if pooling not in POOLINGS:
        raise ValueError(f"pooling '{pooling}', expected {' or '.join(POOLINGS)}")
    falling = all(a > b for a, b in pairwise(counts))
    if counts[0] != len(rest) or counts[-1] != SEGMENTS or not falling:
        raise ValueError(f"counts {counts}, expected to fall from {len(rest)} to {SEGMENTS}")
    groups = topology.segments if pooling == "segments" else np.zeros(len(rest), dtype=np.int32)
    shapes = {
        "body": (rest, topology.faces),
        "skirt": (skirt_body(topology, rest), topology.skirt_faces),
    }
    out = Hierarchy({}, {}, {}, {})
    last: np.ndarray | None = None
    for name, (places, faces) in shapes.items():
        levels = [(np.arange(len(rest)), np.arange(len(rest)))]
        levels += _levels(places, faces, groups, counts[1:])
        if pooling == "segments":
            last = topology.segments
        # The coarsest vertices of both topologies mean the same parts of the body.
        levels[-1] = levels[-1] if last is None else _renumber(*levels[-1], last)
        last = levels[-1][0]
        _add_levels(out, name, levels, edges(faces), places)
    return out


def save_hierarchy(path: str | Path, hierarchy: Hierarchy) -> None:
    """Write the tables as `{topology}/{what}_{level}`, with `parents` named `parent`."""
    arrays = {}
    for topology in TOPOLOGIES:
        for what, tables in _tables(hierarchy).items():
            for level, table in enumerate(tables[topology]):
                arrays[f"{topology}/{what}_{level}"] = table
    save_npz(path, **arrays)


def load_hierarchy(path: str | Path) -> Hierarchy:
    """Read what `save_hierarchy` wrote.

    Raises:
        InputError: the file is missing or lacks a table.
    """
    out = Hierarchy({}, {}, {}, {})
    numbers = {what: LEVELS - (what == "parent") for what in _tables(out)}
    arrays = load_npz(
        path,
        {
            f"{topology}/{what}_{k}": form.format(k=f"{topology}{k}", next=f"{topology}{k + 1}")
            for topology in TOPOLOGIES
            for what, form in _FORMS.items()
            for k in range(numbers[what])
        },
    )
    for what, tables in _tables(out).items():
        for topology in TOPOLOGIES:
            tables[topology] = [arrays[f"{topology}/{what}_{k}"] for k in range(numbers[what])]
    return out


# Sizes of levels differ from one topology to the other.
_FORMS = {
    "parent": "int<{next} {k}",
    "edges": "int<{k} * 2",
    "positions": "float {k} 3",
    "vertices": "int {k}",
}


def _tables(hierarchy: Hierarchy) -> dict[str, dict[str, list[np.ndarray]]]:
    return {
        "parent": hierarchy.parents,
        "edges": hierarchy.edges,
        "positions": hierarchy.positions,
        "vertices": hierarchy.vertices,
    }


def _add_levels(
    out: Hierarchy,
    name: str,
    levels: list[tuple[np.ndarray, np.ndarray]],
    pairs: np.ndarray,
    places: np.ndarray,
) -> None:
    """Turn labels (V,) and standing vertices (n,) of each level into tables."""
    out.parents[name], out.edges[name], out.positions[name], out.vertices[name] = [], [], [], []
    for label, vertices in levels:
        between = np.sort(label[pairs], axis=1)
        apart = between[:, 0] != between[:, 1]
        between = np.unique(between[apart], axis=0)
        out.edges[name].append(between.astype(np.int32))
        out.positions[name].append(places[vertices].astype(np.float32))
        out.vertices[name].append(vertices.astype(np.int32))
    for (_, vertices), (coarser, _) in pairwise(levels):
        out.parents[name].append(coarser[vertices].astype(np.int32))


def _renumber(
    label: np.ndarray, vertices: np.ndarray, wanted: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Renumber a level so that its vertices overlap the wanted ones of the same number most."""
    # Here, because whoever reads a finished hierarchy, as every network does, does without it.
    from scipy.optimize import linear_sum_assignment

    overlap = np.zeros((len(vertices),) * 2)
    np.add.at(overlap, (label, wanted), 1)
    number = linear_sum_assignment(-overlap)[1]
    return number[label], vertices[np.argsort(number)]


def _levels(
    places: np.ndarray, faces: np.ndarray, groups: np.ndarray, counts: Sequence[int]
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Contract edges within groups; yield labels (V,) and standing vertices (n,) at each count."""
    work = _Contraction(places, faces, groups)
    for count in counts:
        work.contract_to(count)
        yield work.level()


class _Contraction:
    """A graph of clusters of vertices, and a queue of its edges.

    In plain numbers and tuples, since every contraction changes a few of them.
    """

    def __init__(self, places: np.ndarray, faces: np.ndarray, groups: np.ndarray) -> None:
        count = len(places)
        area = vertex_areas(places, faces)
        self.alive = count
        self.stands = list(range(count))  # the vertex that each cluster has kept
        self._places = [tuple(p) for p in places.tolist()]
        self._parent = list(range(count))
        self._quadric = [tuple(q) for q in _quadrics(places, faces).tolist()]
        self._centre = [(a, *p) for a, p in zip(area.tolist(), self._places, strict=True)]
        self._version = [0] * count
        self._near: list[set[int]] = [set() for _ in range(count)]
        pairs = edges(faces)
        pairs = pairs[groups[pairs[:, 0]] == groups[pairs[:, 1]]]
        for a, b in pairs.tolist():
            self._near[a].add(b)
            self._near[b].add(a)
        self._queue = [self._entry(a, b) for a, b in pairs.tolist()]
        heapq.heapify(self._queue)

    def contract_to(self, count: int) -> None:
        """Contract the cheapest edges until so many clusters are left."""
        while self.alive > count:
            _, a, b, version_a, version_b = heapq.heappop(self._queue)
            if self._version[a] == version_a and self._version[b] == version_b:
                self._merge(a, b)

    def level(self) -> tuple[np.ndarray, np.ndarray]:
        """Labels (V,), numbered in the order of the vertices that stand, and these (n,)."""
        root = np.array(self._parent)
        while not np.array_equal(root, root[root]):
            root = root[root]
        self._parent = root.tolist()
        stands = np.array(self.stands)[root]
        vertices, label = np.unique(stands, return_inverse=True)
        return label, vertices

    def _entry(self, a: int, b: int) -> tuple[float, int, int, int, int]:
        cost = self._error(a, b)[0] + _SPREAD * self._spread(a, b)
        return cost, a, b, self._version[a], self._version[b]

    def _error(self, a: int, b: int) -> tuple[float, int]:
        """Quadric error of the better of the two standing vertices, and that vertex."""
        xx, xy, xz, yy, yz, zz, x1, y1, z1, one = map(
            float.__add__, self._quadric[a], self._quadric[b]
        )
        best = (float("inf"), 0)
        for vertex in (self.stands[a], self.stands[b]):
            x, y, z = self._places[vertex]
            error = (
                x * (xx * x + 2 * (xy * y + xz * z + x1))
                + y * (yy * y + 2 * (yz * z + y1))
                + z * (zz * z + 2 * z1)
                + one
            )
            best = min(best, (error, vertex))
        return best

    def _spread(self, a: int, b: int) -> float:
        """Squared distance of the clusters' centres, times half the harmonic mean of areas.

        This is what their union adds to the surface's squared distances from the centres of
        clusters: long edges and large clusters come last.
        """
        m, x, y, z = self._centre[a]
        n, u, v, w = self._centre[b]
        return m * n / (m + n) * ((x - u) ** 2 + (y - v) ** 2 + (z - w) ** 2)

    def _merge(self, a: int, b: int) -> None:
        self.stands[a] = self._error(a, b)[1]
        self._quadric[a] = tuple(map(float.__add__, self._quadric[a], self._quadric[b]))
        m, n = self._centre[a][0], self._centre[b][0]
        self._centre[a] = (
            m + n,
            *(
                (m * p + n * q) / (m + n)
                for p, q in zip(self._centre[a][1:], self._centre[b][1:], strict=True)
            ),
        )
        self._parent[b] = a
        self._version[a] += 1
        self._version[b] = -1
        self.alive -= 1
        for near in self._near[b]:
            self._near[near].discard(b)
            if near != a:
                self._near[near].add(a)
                self._near[a].add(near)
        self._near[b].clear()
        for near in sorted(self._near[a]):
            heapq.heappush(self._queue, self._entry(a, near))


def _quadrics(places: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(V, 10) squared distance from the planes of a vertex's faces, times a third of their areas.

    A boundary counts as a wall across the surface, so that it keeps its place (Garland and
    Heckbert). Columns: the upper triangle of (3, 3), three linear terms, the constant.
    """
    a, b, c = (places[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    normal /= np.maximum(size, 1e-20)[:, None]
    out = np.zeros((len(places), 10))
    plane = _plane(normal, a, size / 6)
    for k in range(3):
        np.add.at(out, faces[:, k], plane)
    pairs, sides = edge_counts(faces)
    boundaries = {tuple(pair) for pair in pairs[sides == 1].tolist()}
    for k in range(3):
        start, end = faces[:, k - 1], faces[:, k]
        boundary = [
            tuple(sorted(p)) in boundaries for p in zip(start.tolist(), end.tolist(), strict=True)
        ]
        along = places[end[boundary]] - places[start[boundary]]
        wall = np.cross(along, normal[boundary])
        length = np.linalg.norm(along, axis=1)
        plane = _plane(
            wall / np.maximum(length, 1e-20)[:, None], places[start[boundary]], length**2 / 2
        )
        np.add.at(out, start[boundary], plane)
        np.add.at(out, end[boundary], plane)
    return out


def _plane(normal: np.ndarray, point: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(N, 10) quadrics of planes through points."""
    offset = -np.einsum("ni,ni->n", normal, point)
    row = np.concatenate([normal, offset[:, None]], axis=1)
    upper = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2), (0, 3), (1, 3), (2, 3), (3, 3)]
    return np.stack([row[:, i] * row[:, j] for i, j in upper], axis=1) * weight[:, None]
