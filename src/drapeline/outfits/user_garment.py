"""Garments brought by the user: an OBJ file that lies on the rest body, in place of a template."""

import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from drapeline.bodies.model import BodyModel
from drapeline.errors import InputError
from drapeline.geometry.mesh import (
    Mesh,
    boundary_edges,
    boundary_loops,
    edge_counts,
    edge_graph,
    edges,
    half_edges,
)
from drapeline.geometry.obj import load_obj
from drapeline.outfits.garment_types import GARMENT_TYPES
from drapeline.outfits.wearable import check_wearable

LOGGER = logging.getLogger("drapeline")
_LOOSE_SHARE = 0.1  # more are of faces that are not there any more
_SEAM_M = 1e-5  # between vertices that a seam joins; files round to a hundredth of a millimetre


def load_user_garment(path: str | Path, body: BodyModel, *, mend: bool = False) -> Mesh:
    """Read a user's garment and check that it can be worn.

    Vertices that no face has are dropped and seams, where two edges of the boundary coincide, are
    joined; the log says so.

    Args:
        path: OBJ of all quads or all triangles in metres, Z up, root-relative, on the body's mean
            shape in rest pose.
        body: the body it is for.
        mend: see `check_wearable`.

    Returns:
        The mesh; with a cell of the unit square per face where it has no texture coordinates.

    Raises:
        InputError: the mesh is unreadable, in several parts, closed or inconsistently oriented, has
            edges with more than two faces, or does not lie on the body as if worn.
    """
    mesh = _drop_loose(path, _join_seams(path, load_obj(path)))
    _check_surface(path, mesh)
    mesh = check_wearable(path, mesh, body, mend=mend)
    if mesh.uv is None:
        uv, uv_faces = _atlas(mesh.faces)
        mesh = Mesh(mesh.vertices, mesh.faces, uv, uv_faces)
    return mesh


def openings(mesh: Mesh) -> dict[str, np.ndarray]:
    """Names of `OPENINGS` -> vertex ids of the boundary loops there.

    An opening on one side of the body is one of the "sleeves" above the hips, and one of the "legs"
    below; armholes count as sleeves. Of the others, which lead around the middle, the highest is
    the "top" and the lowest of several the "bottom".

    Args:
        mesh: in the rest pose, relative to the root joint.
    """
    found: dict[str, list[np.ndarray]] = {}
    middle = []
    for loop in boundary_loops(mesh.faces):
        points = mesh.vertices[loop]
        if points[:, 0].min() < 0 < points[:, 0].max():
            middle.append(loop)
        else:
            found.setdefault("sleeves" if points[:, 2].mean() > 0 else "legs", []).append(loop)
    middle.sort(key=lambda loop: -float(mesh.vertices[loop, 2].mean()))
    for name, loops in (("top", middle[:1]), ("bottom", middle[1:][-1:])):
        found[name] = loops
    return {name: np.concatenate(loops) for name, loops in found.items() if loops}


_CHEST_M, _THIGH_M = 0.2, -0.25  # above and below the root joint
_SLEEVE_M = 0.3  # from the middle


def garment_type(path: str | Path, body: BodyModel, *, mend: bool = False) -> str:
    """Which of `GARMENTS` a user's garment is, by what it covers.

    Args:
        path, body, mend: as for `load_user_garment`.

    Raises:
        InputError: it cannot be worn.
    """
    mesh = load_user_garment(path, body, mend=mend)
    x, _, z = mesh.vertices.T
    legs = "legs" in openings(mesh)
    region = "lower" if z.max() < _CHEST_M else "whole"
    if region == "whole" and not legs and z.min() > _THIGH_M:
        region = "upper"
    alike = {
        name: kind.sleeve_chance
        for name, kind in GARMENT_TYPES.items()
        if kind.region == region and not kind.outer and (region == "upper" or kind.skirt != legs)
    }
    sign = 1 if np.abs(x).max() > _SLEEVE_M else -1
    return max(alike, key=lambda name: sign * alike[name])


def rims(path: str | Path, mesh: Mesh, names: Sequence[str], width_m: float) -> np.ndarray:
    """(V,) float32, 1 on the rims of some openings.

    Args:
        path: of the garment, for the error.
        mesh: in the rest pose, relative to the root joint.
        names: of the openings.
        width_m: of a rim.

    Raises:
        InputError: the garment has no opening of a name.
    """
    there = openings(mesh)
    out = np.zeros(len(mesh.vertices), dtype=np.float32)
    for name in names:
        if name not in there:
            raise InputError(f"{path}: has no opening '{name}', expected {' or '.join(there)}")
        distance, _ = KDTree(mesh.vertices[there[name]]).query(mesh.vertices)
        out[distance <= width_m] = 1
    return out


def _check_surface(path: str | Path, mesh: Mesh) -> None:
    degenerate = (np.sort(mesh.faces, axis=1)[:, 1:] == np.sort(mesh.faces, axis=1)[:, :-1]).any(1)
    if degenerate.any():
        face = int(np.flatnonzero(degenerate)[0])
        raise InputError(f"{path}: face {face + 1} names a vertex twice, expected distinct corners")
    pairs, counts = edge_counts(mesh.faces)
    if counts.max() > 2:
        a, b = pairs[counts.argmax()]
        raise InputError(
            f"{path}: {int((counts > 2).sum())} non-manifold edges, the first between vertices"
            f" {a + 1} and {b + 1} with {counts.max()} faces; expected at most 2 faces on an edge"
        )
    _, repeats = np.unique(half_edges(mesh.faces), axis=0, return_counts=True)
    if repeats.max() > 1:
        raise InputError(
            f"{path}: {int((repeats > 1).sum())} edges run the same way in both of their faces;"
            " expected all faces to be turned the same way"
        )
    try:
        loops = boundary_loops(mesh.faces)
    except ValueError as error:
        raise InputError(f"{path}: {error}; expected separate openings") from error
    parts, _ = connected_components(edge_graph(edges(mesh.faces), len(mesh.vertices)), False)
    if parts > 1:
        raise InputError(
            f"{path}: {parts} parts that no edge joins, expected one, or parts whose edges coincide"
            " along seams"
        )
    if not loops:
        raise InputError(f"{path}: a closed surface, expected openings for the body")


def _drop_loose(path: str | Path, mesh: Mesh) -> Mesh:
    used = np.unique(mesh.faces)
    loose = len(mesh.vertices) - len(used)
    if not loose:
        return mesh
    if loose > _LOOSE_SHARE * len(used):
        raise InputError(
            f"{path}: {loose} of {len(mesh.vertices)} vertices are in no face, expected all of"
            " them: the file may be cut off"
        )
    LOGGER.warning("%s: %d vertices that are in no face are left out", path, loose)
    faces = np.searchsorted(used, mesh.faces).astype(np.int32)
    return Mesh(mesh.vertices[used], faces, mesh.uv, mesh.uv_faces)


def _join_seams(path: str | Path, mesh: Mesh) -> Mesh:
    """Let faces share vertices along boundary edges that coincide."""
    pairs = boundary_edges(mesh.faces)
    ends = np.unique(pairs)
    same = KDTree(mesh.vertices[ends]).query_pairs(_SEAM_M, output_type="ndarray")
    if not len(same):
        return mesh
    _, place = connected_components(edge_graph(same, len(ends)), directed=False)
    at = np.sort(place[np.searchsorted(ends, pairs)], axis=1)
    _, which, counts = np.unique(at, axis=0, return_inverse=True, return_counts=True)
    seam = np.unique(pairs[(counts[which.ravel()] == 2) & (at[:, 0] != at[:, 1])])
    if not len(seam):
        return mesh
    target = np.arange(len(mesh.vertices))
    places = place[np.searchsorted(ends, seam)]
    first, back = np.unique(places, return_index=True)
    target[seam] = seam[back][np.searchsorted(first, places)]
    joined = int((target != np.arange(len(target))).sum())
    LOGGER.warning("%s: joined along seams, where %d vertices coincide with others", path, joined)
    kept = np.setdiff1d(np.arange(len(target)), seam[target[seam] != seam])
    faces = np.searchsorted(kept, target[mesh.faces]).astype(np.int32)
    return Mesh(mesh.vertices[kept], faces, mesh.uv, mesh.uv_faces)


def _atlas(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A cell of the unit square for every face, for garments without texture coordinates."""
    count, corners = faces.shape
    side = int(np.ceil(np.sqrt(count)))
    cell = np.stack(np.divmod(np.arange(count), side), axis=1)[:, ::-1]
    square = np.array([[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.1, 0.9]])[:corners]
    uv = (cell[:, None] + square) / side
    numbers = np.arange(count * corners).reshape(count, corners)
    return uv.reshape(-1, 2).astype(np.float32), numbers.astype(np.int32)
