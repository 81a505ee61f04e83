"""Garments brought by the user: an OBJ file that lies on the rest body, in place of a template."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import rest_body
from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh, boundary_loops, edge_counts, half_edges
from drapeline.geometry.obj import load_obj

_HUGE_M = 5.0  # no garment for a person of 2 m is larger
_TINY_M = 0.05
_FAR_M = 0.25


def load_user_garment(path: str | Path, body: BodyModel) -> Mesh:
    """Read a user's garment and check that it can be worn.

    Args:
        path: OBJ of all quads or all triangles in metres, Z up, root-relative, on the body's mean
            shape in rest pose.
        body: the body it is for.

    Returns:
        The mesh; with a cell of the unit square per face where it has no texture coordinates.

    Raises:
        InputError: the mesh is unreadable, not finite, in other units, away from the body, closed
            or inconsistently oriented, or has edges with more than two faces.
    """
    mesh = load_obj(path)
    if not np.isfinite(mesh.vertices).all():
        bad = int(np.flatnonzero(~np.isfinite(mesh.vertices).all(axis=1))[0])
        raise InputError(f"{path}: vertex {bad + 1} is not finite, expected metres")
    size = float(np.ptp(mesh.vertices, axis=0).max())
    if not _TINY_M < size < _HUGE_M:
        unit = ", which looks like centimetres" if size > _HUGE_M else ""
        raise InputError(
            f"{path}: the garment is {size:.4g} m long{unit}; expected metres,"
            f" between {_TINY_M} and {_HUGE_M}"
        )
    _check_surface(path, mesh)
    _check_place(path, mesh, rest_body(body, np.zeros(10)))
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
    if not loops:
        raise InputError(f"{path}: a closed surface, expected openings for the body")


def _check_place(path: str | Path, mesh: Mesh, body: np.ndarray) -> None:
    distance, _ = KDTree(body).query(mesh.vertices)
    if distance.min() > _FAR_M:
        middle = mesh.vertices.mean(axis=0)
        raise InputError(
            f"{path}: the garment is {distance.min():.2f} m from the rest body, its middle at"
            f" ({middle[0]:.2f}, {middle[1]:.2f}, {middle[2]:.2f}) m; expected it on the body,"
            f" whose pelvis is at the origin, within {_FAR_M} m"
        )


def _atlas(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A cell of the unit square for every face, for garments without texture coordinates."""
    count, corners = faces.shape
    side = int(np.ceil(np.sqrt(count)))
    cell = np.stack(np.divmod(np.arange(count), side), axis=1)[:, ::-1]
    square = np.array([[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.1, 0.9]])[:corners]
    uv = (cell[:, None] + square) / side
    numbers = np.arange(count * corners).reshape(count, corners)
    return uv.reshape(-1, 2).astype(np.float32), numbers.astype(np.int32)
