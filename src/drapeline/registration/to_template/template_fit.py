"""Garments of any topology are brought to a template's (Garment4D, section 2.2).

The source garment is deformed onto the template in three steps: its openings and seams, its
surface, and equation 3.
"""

from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.optimize import minimize
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from drapeline.errors import InputError
from drapeline.geometry.least_squares import symmetric_factor
from drapeline.geometry.mesh import (
    boundary_loops,
    edge_counts,
    edge_lengths,
    edges,
    half_edges,
    triangulate,
    vertex_normals,
)
from drapeline.geometry.smoothing import uniform_laplacian
from drapeline.registration.settings import TemplateFitSettings
from drapeline.registration.to_template.garment_template import GarmentTemplate, named_loops

_FRONT_M = 0.04  # wider gaps are not a front that has come open a little
# Along the boundary, two vertices on the sides of a gap are at least this far apart ...
_APART_M = 0.045
_APART_TIMES = 3.0  # ... and so many times further than across it
_ONWARD = 0.8  # cosine at which a boundary runs away from the other side: the front has ended


def front_strip(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Faces (n, 3) that close the front of a shirt, none where it is closed.

    Args:
        vertices: (V, 3) metres, root frame, in `REST_POSE`.
        triangles: (F, 3) of an open shirt, a polo or a closed one.

    Returns:
        Triangles between the two sides of the opening, turned as their neighbours are.
    """
    loops = boundary_loops(triangles)
    # Cuffs lie furthest to the sides, and tight ones must not be sewn up.
    aside = sorted(loops, key=lambda loop: abs(vertices[loop, 0].mean()))
    cuffs = 2 if len(loops) > 2 else 0
    strips = [_strip(vertices, loop) for loop in aside[: len(loops) - cuffs]]
    return np.concatenate(strips).astype(triangles.dtype)


def _strip(vertices: np.ndarray, loop: np.ndarray) -> np.ndarray:
    points = vertices[loop]
    step = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    at = np.concatenate([[0.0], np.cumsum(step)[:-1]])
    along = np.abs(at[:, None] - at)
    along = np.minimum(along, step.sum() - along)
    across = np.linalg.norm(points[:, None] - points, axis=-1)
    gap = (along > _APART_M) & (along > _APART_TIMES * across)
    across = np.where(gap, across, np.inf)
    start = np.unravel_index(across.argmin(), across.shape)
    if across[start] > _FRONT_M:
        return np.zeros((0, 3), dtype=np.int64)
    first, second = sorted(start)
    count = len(loop)
    # From the narrowest place the strip runs both ways along the boundary.
    inner = _zip_arc(points, np.arange(first, second + 1))
    outer = _zip_arc(points, np.arange(second, first + count + 1) % count)
    return loop[np.array(inner + outer, dtype=np.int64).reshape(-1, 3)]


def _zip_arc(points: np.ndarray, arc: np.ndarray) -> list[tuple[int, int, int]]:
    """Triangles over a part of the boundary (n,), from its ends inwards while they stay close."""
    made = []
    low, high = 0, len(arc) - 1
    while high - low > 1:
        ways = []
        for at, after, other in ((low, low + 1, high), (high, high - 1, low)):
            p, q, r = points[arc[at]], points[arc[after]], points[arc[other]]
            ahead, from_other = q - p, p - r
            far, step = np.linalg.norm(q - r), np.linalg.norm(ahead)
            turn = ahead @ from_other
            size = step * np.linalg.norm(from_other)
            if far < np.hypot(_FRONT_M, step) and turn < _ONWARD * size:
                ways.append((far, after))
        if not ways:
            break
        after = min(ways)[1]
        # Against the direction of the boundary, along which the cloth lies to the left.
        made.append((arc[high], arc[after], arc[low]))
        low, high = (after, high) if after == low + 1 else (low, after)
    return made


_HELD = 1e3  # weight of what must stay, against 1 of what is drawn
_STARTS = 64  # places on an opening at which the match of two loops may begin
_MM2 = 1e6  # equation 3 is minimised in mm^2: in m^2 the solver would take it for solved
# Stiffness of the surface while it is drawn to the template, for each round.
_STIFFNESS = (10.0, 10.0, 3.0, 3.0, 1.0, 1.0)
# Distance that a turn of the normal by one radian counts for: it keeps one trouser leg off the
# other, and a sleeve off the torso.
_TURN_M = 0.1
_STRAIGHT = -0.75  # cosine at an armpit beyond which there is no sleeve: the side runs on
# Sleeveless garments are fitted to a template with sleeves of this share of their length. To whole
# ones, cloth from the sides would be drawn out along the arms, and fold under them.
_STUB = 0.25
_HEM_M = 0.1  # from its lowest point up, an opening is where the way from the cuff down ends
_ASIDE_M = 0.003  # this far from the body's middle a seam counts as twice as long


class Fit(NamedTuple):
    """A source garment on a template."""

    vertices: np.ndarray  # (V, 3) float64 metres, the deformed source
    rest: np.ndarray  # (V, 3) float64 metres, the source itself
    triangles: np.ndarray  # (F, 3) of the source, with those that close its front
    loops: dict[str, np.ndarray]  # opening -> ordered vertex ids of the source
    # Lines of vertex ids that were matched besides them: armpits, and the seams from the crotch up.
    guides: list[np.ndarray]
    target: "FitTarget"  # that it lies on


class FitTarget:
    """A template prepared for the fit; worth keeping for many garments.

    Args:
        template: kept as an attribute.

    Attributes:
        vertices: (N, 3) float64.
        loops: opening -> ordered vertex ids.
        normals: (N, 3).
        guides: lines of vertex ids that are matched besides the openings.
        sleeved: whether it has sleeves.
        points: (N + E, 3) vertices and middles of edges: garments finer than the template would
            otherwise gather about its vertices.
        boundaries: opening -> the points on it.
    """

    def __init__(self, template: GarmentTemplate) -> None:
        self.template = template
        self.vertices = template.vertices.astype(np.float64)
        self.normals = vertex_normals(self.vertices, template.faces)
        self.loops = named_loops(self.vertices, boundary_loops(template.faces), template.loop_names)
        self.guides, self.sleeved = _guides(self.vertices, template.faces, self.loops)
        pairs, counts = edge_counts(template.faces)
        middles = self.vertices[pairs].mean(axis=1)
        self.points = np.concatenate([self.vertices, middles])
        at_boundary = np.where(counts == 1, template.loop[pairs[:, 0]], -1)
        number = np.concatenate([template.loop, at_boundary])
        self.boundaries = {
            name: self.points[number == k] for k, name in enumerate(template.loop_names)
        }

    @cached_property
    def stubbed(self) -> "FitTarget":
        """The same with next to no sleeves."""
        vertices = self.template.vertices.copy()
        for armpit in vertices[[guide[0] for guide in self.guides if len(guide) == 1]]:
            out = np.sign(armpit[0]) * vertices[:, 0] - abs(armpit[0])
            vertices[:, 0] -= np.sign(armpit[0]) * (1 - _STUB) * np.maximum(out, 0)
        return FitTarget(replace(self.template, vertices=vertices))

    @cached_property
    def tree(self) -> cKDTree:
        """Search tree of `points`."""
        return cKDTree(self.points)

    @cached_property
    def boundary_trees(self) -> dict[str, cKDTree]:
        """Search trees of `boundaries`."""
        return {name: cKDTree(boundary) for name, boundary in self.boundaries.items()}


def fit_to_template(
    vertices: np.ndarray,
    faces: np.ndarray,
    template: GarmentTemplate | FitTarget,
    settings: TemplateFitSettings | None = None,
) -> Fit:
    """Deform a garment onto the template of its type.

    Args:
        vertices: (V, 3) metres, root frame, in `REST_POSE`.
        faces: (F, 3) or (F, 4).
        template: of the garment's type; for many garments a `FitTarget` saves its preparation.
        settings: the defaults if None.

    Raises:
        InputError: the garment lacks an opening that its type has.
    """
    target = template if isinstance(template, FitTarget) else FitTarget(template)
    settings = settings or TemplateFitSettings()
    rest = np.asarray(vertices, dtype=np.float64)
    triangles = triangulate(np.asarray(faces))
    names = target.template.loop_names
    if "neck" in names:
        triangles = np.concatenate([triangles, front_strip(rest, triangles)])
    loops = named_loops(rest, boundary_loops(triangles), names)
    missing = [name for name in names if name not in loops]
    if missing:
        raise InputError(
            f"the garment has no {' and no '.join(missing)},"
            f" expected the openings {', '.join(names)}"
        )
    guides, sleeved = _guides(rest, triangles, loops)
    if target.sleeved and not sleeved:
        target = target.stubbed
    places = _match_boundaries(rest, triangles, loops, guides, target)
    held = np.concatenate([*loops.values(), *guides])
    places = _draw_to_surface(places, triangles, held, target)
    equation = Equation3(triangles, loops, target, settings)
    return Fit(equation.minimise(places), rest, triangles, loops, guides, target)


def _guides(
    vertices: np.ndarray, triangles: np.ndarray, loops: dict[str, np.ndarray]
) -> tuple[list[np.ndarray], bool]:
    """Lines of vertex ids to match besides the openings, where limbs part; whether it has sleeves.

    Under each arm a line of one vertex, the armpit: the corner of the shortest way from the cuff
    down. Between the legs the seam along the body's middle, from the crotch to the topmost opening
    in front and behind.
    """
    pairs = edges(triangles)
    length = edge_lengths(vertices, pairs)
    guides, sleeved = [], False
    if "left_cuff" in loops:
        graph = sp.coo_matrix((length, pairs.T), shape=(len(vertices),) * 2).tocsr()
        for side in ("left", "right"):
            cuff = loops[f"{side}_cuff"]
            below = np.concatenate(
                [loops[name] for name in ("hem", "edge", f"{side}_leg") if name in loops]
            )
            # Of a jacket's edge, the hem.
            below = below[vertices[below, 2] < vertices[below, 2].min() + _HEM_M]
            path = _path(graph, below, cuff)
            armpit = _corner(vertices[path])
            guides.append(path[armpit][None])
            sleeved |= _cosine(vertices[path], armpit) > _STRAIGHT
    if "left_leg" in loops:
        top = loops["waist" if "waist" in loops else "neck"]
        guides += _crotch_seam(vertices, pairs, length, top)
    return guides, sleeved


def _crotch_seam(
    vertices: np.ndarray, pairs: np.ndarray, length: np.ndarray, top: np.ndarray
) -> list[np.ndarray]:
    """Vertex ids from the crotch to an opening at the top, behind and in front."""
    aside = np.abs(vertices[pairs, 0]).mean(axis=1)
    graph = sp.coo_matrix((length * (1 + aside / _ASIDE_M), pairs.T), shape=(len(vertices),) * 2)
    behind = vertices[top, 1] > vertices[top, 1].mean()  # the body faces -Y
    middles = [half[np.abs(vertices[half, 0]).argmin()] for half in (top[behind], top[~behind])]
    seam = _path(graph.tocsr(), *(middle[None] for middle in middles))
    crotch = _corner(vertices[seam])
    # The last vertex of each belongs to the opening.
    return [seam[crotch:0:-1], seam[crotch:-1]]


def _path(graph: sp.csr_matrix, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """Ids along the shortest way over edges, from one of `stop` to one of `start`."""
    way, before, _ = dijkstra(
        graph, directed=False, indices=start, min_only=True, return_predecessors=True
    )
    path = [stop[way[stop].argmin()]]
    while before[path[-1]] >= 0:
        path.append(before[path[-1]])
    return np.array(path)


def _corner(line: np.ndarray) -> int:
    """Index of the point of a line (n, 3) furthest from the straight one between its ends."""
    gap = line - line[0]
    chord = gap[-1]
    away = gap - (gap @ chord / (chord @ chord))[:, None] * chord
    return int((away**2).sum(axis=1).argmax())


def _cosine(line: np.ndarray, corner: int) -> float:
    """Between the ways from a corner of a line (n, 3) to its ends; -1 where it is straight."""
    ways = line[[0, -1]] - line[corner]
    size = np.linalg.norm(ways, axis=1).prod()
    return float(ways[0] @ ways[1] / size) if size else -1.0


def _match_boundaries(
    rest: np.ndarray,
    triangles: np.ndarray,
    loops: dict[str, np.ndarray],
    guides: list[np.ndarray],
    target: FitTarget,
) -> np.ndarray:
    """Move openings and guides onto those of the template; the cloth between follows smoothly."""
    laplacian = uniform_laplacian(triangles, len(rest))
    weight, move = np.zeros(len(rest)), np.zeros_like(rest)
    for name, loop in loops.items():
        weight[loop] = _HELD
        move[loop] = _match_ring(rest[loop], target.vertices[target.loops[name]]) - rest[loop]
    for guide, line in zip(guides, target.guides, strict=True):
        weight[guide] = _HELD
        move[guide] = _stretch_along(rest[guide], target.vertices[line]) - rest[guide]
    return rest + symmetric_factor(laplacian + sp.diags(weight)).solve(weight[:, None] * move)


def _match_ring(points: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """Places (n, 3) on a closed line (m, 3) at the points' shares of their own line's length.

    Both run the same way around. The start is chosen so that the points move least, a shift of
    their middle aside.
    """
    share = _shares(points)[:-1]
    at = np.concatenate([_shares(ring), 1 + _shares(ring)[1:]])
    twice = np.concatenate([ring, ring, ring[:1]])
    own = points - points.mean(axis=0)

    def best_of(starts: np.ndarray) -> tuple[float, np.ndarray]:
        places = (starts % 1)[:, None] + share
        moved = np.stack([np.interp(places, at, twice[:, k]) for k in range(3)], axis=-1)
        gap = moved - moved.mean(axis=1, keepdims=True) - own
        best = (gap**2).sum(axis=(1, 2)).argmin()
        return starts[best], moved[best]

    first, _ = best_of(np.arange(_STARTS) / _STARTS)
    return best_of(first + np.linspace(-1, 1, _STARTS + 1) / _STARTS)[1]


def _stretch_along(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Places (n, 3) on a line (m, 3) with ends, at the points' shares of their own."""
    share, at = (_line_shares(p) for p in (points, line))
    return np.column_stack([np.interp(share, at, line[:, k]) for k in range(3)])


def _shares(ring: np.ndarray) -> np.ndarray:
    """(n + 1,) share of the length of a closed line (n, 3) up to each point, 0 to 1."""
    return _line_shares(np.concatenate([ring, ring[:1]]))


def _line_shares(line: np.ndarray) -> np.ndarray:
    """(n,) share of the length of a line (n, 3) up to each point, 0 to 1."""
    total = np.cumsum(np.linalg.norm(np.diff(line, axis=0, prepend=line[:1]), axis=1))
    return total / max(total[-1], 1e-12)


def _draw_to_surface(
    places: np.ndarray, triangles: np.ndarray, held: np.ndarray, target: FitTarget
) -> np.ndarray:
    """Draw vertices, but for those held, to the closest cloth that faces the same way."""
    laplacian = uniform_laplacian(triangles, len(places))
    weight = np.ones(len(places))
    weight[held] = _HELD
    tree = cKDTree(np.hstack([target.vertices, _TURN_M * target.normals]))
    factors = {
        s: symmetric_factor(sp.diags(weight) + s * laplacian) for s in dict.fromkeys(_STIFFNESS)
    }
    for stiffness in _STIFFNESS:
        own = vertex_normals(places, triangles)
        _, near = tree.query(np.hstack([places, _TURN_M * own]))
        normals = target.normals[near]
        gap = ((target.vertices[near] - places) * normals).sum(axis=1, keepdims=True)
        gap[held] = 0
        places = places + factors[stiffness].solve(weight[:, None] * gap * normals)
    return places


class Equation3:
    """Equation 3 of Garment4D for one source garment R' and a template T.

    L_reg = lambda_c CD(R', T) + lambda_e EL(R') + lambda_n NC(R') + lambda_b CD^B(R', T)

    CD is the mean squared distance to the closest vertex, in both directions. EL is the variance
    of the edges' lengths and NC the mean of 1 - cos between neighbouring faces, as the paper
    names these terms without a formula. CD^B is the mean of CD over the openings.
    """

    def __init__(
        self,
        triangles: np.ndarray,
        loops: dict[str, np.ndarray],
        target: FitTarget,
        settings: TemplateFitSettings,
    ) -> None:
        """Index the edges and the neighbouring faces of the source."""
        self._triangles, self._loops, self._target = triangles, loops, target
        self._settings = settings
        self._edges = edges(triangles)
        half = np.sort(half_edges(triangles), axis=1).astype(np.int64)
        key = half[:, 0] * (int(half.max()) + 1) + half[:, 1]
        order = np.argsort(key, kind="stable")
        same = np.flatnonzero(key[order[1:]] == key[order[:-1]])
        self._hinges = np.stack([order[same], order[same + 1]], axis=1) // 3  # (H, 2) faces

    def __call__(self, places: np.ndarray) -> tuple[float, np.ndarray]:
        """L_reg of vertices (V, 3) in m^2, and its gradient (V, 3) with closest pairs fixed."""
        wanted, target = self._settings, self._target
        gradient = np.zeros_like(places)
        value = wanted.chamfer * _chamfer(
            places, target.points, target.tree, wanted.chamfer, gradient
        )
        boundaries = wanted.boundary / len(self._loops)
        for name, loop in self._loops.items():
            part = np.zeros((len(loop), 3))
            value += boundaries * _chamfer(
                places[loop], target.boundaries[name], target.boundary_trees[name], boundaries, part
            )
            gradient[loop] += part
        value += wanted.edge * self._edge_term(places, wanted.edge, gradient)
        value += wanted.normal * self._normal_term(places, wanted.normal, gradient)
        return value, gradient

    def minimise(self, places: np.ndarray) -> np.ndarray:
        """Vertices (V, 3) after at most `iterations` steps of L-BFGS from `places`."""
        if not self._settings.iterations:
            return places

        def energy_mm2(flat: np.ndarray) -> tuple[float, np.ndarray]:
            value, gradient = self(flat.reshape(-1, 3))
            return _MM2 * value, _MM2 * gradient.ravel()

        result = minimize(
            energy_mm2,
            places.ravel(),
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": self._settings.iterations, "gtol": 0.0, "ftol": 1e-5},
        )
        return result.x.reshape(-1, 3)

    def _edge_term(self, places: np.ndarray, weight: float, gradient: np.ndarray) -> float:
        along = places[self._edges[:, 1]] - places[self._edges[:, 0]]
        length = np.linalg.norm(along, axis=1)
        excess = length - length.mean()
        # The mean moves too, but the excesses sum to zero, so that it drops out.
        slope = (2 * weight / len(length)) * excess / np.maximum(length, 1e-12)
        _add(gradient, self._edges[:, 1], slope[:, None] * along)
        _add(gradient, self._edges[:, 0], -slope[:, None] * along)
        return float((excess**2).mean())

    def _normal_term(self, places: np.ndarray, weight: float, gradient: np.ndarray) -> float:
        corners = places[self._triangles]
        one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        cross = np.cross(one, two)
        size = np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-12)
        normals = cross / size
        first, second = self._hinges.T
        # d/dn of the sum of -n1.n2 for every face: minus the sum of its neighbours' normals.
        pull = np.zeros_like(normals)
        _add(pull, first, -normals[second])
        _add(pull, second, -normals[first])
        pull *= weight / len(first)
        # Through the unit length, and through the cross product.
        pull = (pull - (pull * normals).sum(axis=1, keepdims=True) * normals) / size
        to_one, to_two = np.cross(two, pull), np.cross(pull, one)
        _add(gradient, self._triangles[:, 1], to_one)
        _add(gradient, self._triangles[:, 2], to_two)
        _add(gradient, self._triangles[:, 0], -to_one - to_two)
        return float(1 - (normals[first] * normals[second]).sum(axis=1).mean())


def _chamfer(
    places: np.ndarray, points: np.ndarray, tree: cKDTree, weight: float, gradient: np.ndarray
) -> float:
    """Mean squared distances of two sets of points, both ways; the gradient is added in place."""
    forward, near = tree.query(places)
    # A tree that is queried once is not worth balancing.
    backward, own = cKDTree(places, balanced_tree=False, compact_nodes=False).query(points)
    gradient += (2 * weight / len(places)) * (places - points[near])
    _add(gradient, own, (2 * weight / len(points)) * (places[own] - points))
    return float((forward**2).mean() + (backward**2).mean())


def _add(total: np.ndarray, rows: np.ndarray, values: np.ndarray) -> None:
    """Add values (n, 3) to rows of `total` that may repeat; faster than `np.add.at`."""
    for axis in range(3):
        total[:, axis] += np.bincount(rows, values[:, axis], len(total))
