"""Garments at rest, worn in a pose, in layers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from drapeline.bodies.follow import PosedBody, pose_garment
from drapeline.geometry.closest import closest_points
from drapeline.geometry.collision import PenetrationResolver
from drapeline.geometry.mesh import Mesh, boundary_edges, face_normals
from drapeline.geometry.smoothing import averaging_matrix, spread_pushes

GAP_M = 0.004  # between layers of cloth
_LAYER_M = 0.05  # cloth deeper than this below another layer is not meant to be over it
_ROUNDS, _SPREAD = 3, 4


class DrapedSheet(NamedTuple):
    """The same cloth at rest, root-relative metres, and as it hangs on a posed wearer."""

    rest: Mesh  # (V, 3) vertices with faces
    posed: Mesh  # the same faces, in the world


@dataclass(frozen=True)
class SkinningOptions:
    """Options of garments that follow the body, see `pose_garment`."""

    neighbours: int = 8  # vertices of the body that a vertex follows; 1 in SMPLicit's paper
    smoothing: int = 20  # passes that smooth the motions over a garment; none in the paper


def pose_in_layers(
    garments: Mapping[str, Mesh], body: PosedBody, skinning: SkinningOptions
) -> dict[str, Mesh]:
    """Garments at rest, the innermost first, posed and in layers; some may have no faces."""
    posed = [
        pose_garment(one, body, neighbours=skinning.neighbours, smoothing=skinning.smoothing)
        if len(one.faces)
        else one
        for one in garments.values()
    ]
    return dict(zip(garments, stack_layers(posed, body), strict=True))


def stack_layers(sheets: Sequence[Mesh], body: PosedBody) -> list[Mesh]:
    """Posed sheets, the innermost first, pushed out of the body, and each out of those below it."""
    resolver = PenetrationResolver(body.posed.astype(np.float32), body.faces)
    worn: list[Mesh] = []
    for sheet in sheets:
        if len(sheet.faces):
            average = averaging_matrix(sheet.faces, len(sheet.vertices))
            vertices = resolver.push_out(sheet.vertices, average)
            for inner in worn:
                if len(inner.faces):
                    vertices = push_over(vertices, average, inner)
            sheet = Mesh(vertices, sheet.faces)
        worn.append(sheet)
    return worn


def push_over(
    cloth: np.ndarray,
    average: sp.csr_matrix,
    inner: Mesh,
    *,
    gap_m: float = GAP_M,
    beyond_m: float = 0.0,
) -> np.ndarray:
    """Cloth (V, 3) moved to the outer side of an open sheet, wherever that lies over it.

    Args:
        cloth: metres.
        average: (V, V) of `averaging_matrix`.
        inner: the sheet.
        gap_m: between both.
        beyond_m: how far the sheet's plane counts beyond its open edges. Past an opening there is
            nothing to be over, whatever side of the last face it is.
    """
    edge = np.zeros(len(inner.vertices), dtype=bool)
    edge[boundary_edges(inner.faces)] = True
    at_edge = edge[inner.faces].any(axis=1)
    for round_ in range(_ROUNDS):
        place, face = closest_points(cloth, inner.vertices, inner.faces)
        normal = face_normals(inner.vertices, inner.faces[face])
        away = cloth - place
        height = np.einsum("vi,vi->v", away, normal)
        reach = np.where(at_edge[face], beyond_m, _LAYER_M)
        below = (height < gap_m) & (np.linalg.norm(away, axis=1) < reach)
        if not below.any():
            break
        push = np.where(below, gap_m - height, 0)[:, None] * normal
        if round_ < _ROUNDS - 1:
            push = spread_pushes(push, average, _SPREAD)
        cloth = (cloth + push).astype(cloth.dtype)
    return cloth
