"""All garments of an outfit as one system of particles, and the colours of its constraints."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import warp as wp

from drapeline.geometry.lanes import LANES, fill_lanes
from drapeline.geometry.mesh import edges, triangulate
from drapeline.simulation.solver import ClothGarment
from drapeline.xpbd.elasticity import Hinges, Springs, make_hinges, make_springs, triangle_areas
from drapeline.xpbd.threads import warp_directions

wp.set_module_options({"enable_backward": False})

_DEVICE = "cpu"  # greedy colouring is serial
_MOST_COLOURS = wp.constant(64)


@wp.kernel
def _colour(
    vertices: wp.array2d[int],
    taken: wp.array[wp.uint64],  # bit c of a vertex: it has a constraint of colour c
    colours: wp.array[int],
):
    i = wp.tid()
    used = wp.uint64(0)
    for k in range(vertices.shape[1]):
        used = used | taken[vertices[i, k]]
    colour = int(0)  # noqa: RUF046, UP018  (a plain 0 would be a constant)
    while colour < _MOST_COLOURS - 1 and ((used >> wp.uint64(colour)) & wp.uint64(1)) == wp.uint64(
        1
    ):
        colour += 1
    colours[i] = colour
    for k in range(vertices.shape[1]):
        vertex = vertices[i, k]
        taken[vertex] = taken[vertex] | (wp.uint64(1) << wp.uint64(colour))


def colour_constraints(vertices: np.ndarray, count: int) -> np.ndarray:
    """Colours (C,) such that no two constraints of one colour have a vertex in common.

    Greedy: each constraint takes the first colour that is free at all of its vertices. What is
    solved colour by colour has no direction, as lexical order would have, and all constraints of a
    colour can be solved at once (Fratarcangeli et al. 2016, "Vivace").

    Args:
        vertices: (C, K) int; a constraint may name a vertex twice.
        count: of vertices.
    """
    colours = wp.zeros(len(vertices), dtype=int, device=_DEVICE)
    wp.launch(
        _colour,
        dim=len(vertices),
        inputs=[wp.array(vertices.astype(np.int32), dtype=int, device=_DEVICE)],
        outputs=[wp.zeros(count, dtype=wp.uint64, device=_DEVICE), colours],
        device=_DEVICE,
    )
    found = colours.numpy().copy()
    late = np.flatnonzero(found == _MOST_COLOURS - 1)
    found[late] += np.arange(len(late), dtype=found.dtype)  # each has one of its own
    return found


Constraints = TypeVar("Constraints", Springs, Hinges)


@dataclass(frozen=True)
class ClothSystem:
    """Garments at rest, one after the other."""

    vertices: np.ndarray  # (V, 3) float32 metres in frame 0
    inverse_masses: np.ndarray  # (V,) in 1/kg
    drag_1_s: np.ndarray  # (V,) rate at which still air takes speed away
    # skin_friction, self_friction: (V,) coefficients of a vertex's fabric.
    skin_friction: np.ndarray
    self_friction: np.ndarray
    triangles: np.ndarray  # (F, 3) int32, halves of a quad next to one another
    layers: np.ndarray  # (V,) int32, number of a vertex's garment, from inner to outer
    starts: np.ndarray  # (G + 1,) where each garment begins
    # springs, hinges: in order of their colours; springs along edges before diagonals.
    springs: Springs
    hinges: Hinges
    # spring_lanes, hinge_lanes: (R, width), which of them are solved at once, see `fill_lanes`.
    spring_lanes: np.ndarray
    hinge_lanes: np.ndarray
    # spring_rows, hinge_rows: (C + 1,), where the rows of each colour begin.
    spring_rows: np.ndarray
    hinge_rows: np.ndarray
    pinned: np.ndarray  # (P,) int32, vertices that are held
    pin_weights: np.ndarray  # (P,) 0-1

    def split(self, vertices: np.ndarray) -> list[np.ndarray]:
        """Vertices (V, 3) by garment."""
        return np.split(vertices, self.starts[1:-1])


def join_garments(garments: Sequence[ClothGarment], width: int = LANES) -> ClothSystem:
    """Make one system of garments, from inner to outer, for lanes of a width."""
    sizes = [len(g.vertices) for g in garments]
    starts = np.concatenate([[0], np.cumsum(sizes)])
    masses = [_masses(g) for g in garments]
    drag = [
        np.full(len(g.vertices), g.fabric.drag_kg_m2_s / g.fabric.density_kg_m2) for g in garments
    ]
    rest = [g.vertices.astype(np.float64) for g in garments]
    warps = [warp_directions(v, g.faces) for v, g in zip(rest, garments, strict=True)]
    woven = list(zip(rest, garments, warps, strict=True))
    springs = [make_springs(v, g.faces, g.fabric, g.shrink, warp) for v, g, warp in woven]
    hinges = [make_hinges(v, g.faces, g.fabric, warp, g.stiffness) for v, g, warp in woven]
    pairs = [edges(g.faces) for g in garments]
    diagonal = [np.arange(len(s.pairs)) >= len(p) for s, p in zip(springs, pairs, strict=True)]
    joined_springs, spring_lanes, spring_rows = _join_constraints(
        springs, "pairs", starts, np.concatenate(diagonal), width
    )
    joined_hinges, hinge_lanes, hinge_rows = _join_constraints(
        hinges,
        "vertices",
        starts,
        np.zeros(sum(len(h.vertices) for h in hinges), dtype=bool),
        width,
    )
    return ClothSystem(
        vertices=np.concatenate([g.vertices for g in garments]).astype(np.float32),
        inverse_masses=1 / np.concatenate(masses),
        drag_1_s=np.concatenate(drag),
        skin_friction=np.repeat([g.fabric.skin_friction for g in garments], sizes),
        self_friction=np.repeat([g.fabric.self_friction for g in garments], sizes),
        triangles=_join([triangulate(g.faces) for g in garments], starts),
        layers=np.repeat(np.arange(len(garments), dtype=np.int32), sizes),
        starts=starts,
        springs=joined_springs,
        hinges=joined_hinges,
        spring_lanes=spring_lanes,
        hinge_lanes=hinge_lanes,
        spring_rows=spring_rows,
        hinge_rows=hinge_rows,
        pinned=_join([g.pins.vertices for g in garments], starts),
        pin_weights=np.concatenate([g.pins.weights for g in garments]),
    )


def _masses(garment: ClothGarment) -> np.ndarray:
    """Masses (V,) in kg: a third of each triangle's."""
    triangles = triangulate(garment.faces)
    area = triangle_areas(garment.vertices.astype(np.float64), triangles)
    corners = np.bincount(
        triangles.ravel(), np.repeat(area / 3, 3), minlength=len(garment.vertices)
    )
    return np.maximum(corners, area.mean() / 100) * garment.fabric.density_kg_m2


def _join(numbers: Sequence[np.ndarray], starts: np.ndarray) -> np.ndarray:
    """Numbers of vertices, of all garments."""
    return np.concatenate(
        [part + start for part, start in zip(numbers, starts[:-1], strict=True)]
    ).astype(np.int32)


def _join_constraints(
    parts: Sequence[Constraints], ends: str, starts: np.ndarray, later: np.ndarray, width: int
) -> tuple[Constraints, np.ndarray, np.ndarray]:
    """Constraints of all garments in the order of their colours, their lanes and colours' rows.

    Those that are to come `later` (C,) have colours of their own.
    """
    joined = _join([getattr(part, ends) for part in parts], starts)
    colours = colour_constraints(joined, int(starts[-1]))
    colours += later * (1 + colours.max(initial=0))
    order = np.argsort(colours, kind="stable")
    kind = type(parts[0])
    fields = {
        name: np.concatenate([getattr(part, name) for part in parts])[order]
        for name in kind.__dataclass_fields__
        if name != ends
    }
    lanes = fill_lanes(colours[order], width)
    starts_colour = np.diff(colours[order][lanes[:, 0]], prepend=-1) > 0
    rows = np.append(np.flatnonzero(starts_colour), len(lanes))
    return kind(**{ends: joined[order]}, **fields), lanes, rows
