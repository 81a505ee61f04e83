"""A garment in the topology of its template (Garment4D, section 2.2).

Where the template's vertices lie on a source garment that was laid onto it tells which corners of
the source they follow in every frame.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import igl
import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from drapeline.dataset.reader import Sample
from drapeline.dataset.record import read_record
from drapeline.dataset.shards import samples_of
from drapeline.errors import InputError
from drapeline.geometry.closest import closest_points
from drapeline.geometry.mesh import (
    boundary_loops,
    edge_graph,
    edges,
    face_normals,
    triangulate,
    vertex_normals,
)
from drapeline.outfits.static import load_static
from drapeline.registration.error_table import FILE_NAME, Measure, error_rows, write_errors
from drapeline.registration.settings import TemplateFitSettings
from drapeline.registration.to_template.garment_template import GarmentTemplate
from drapeline.registration.to_template.template_fit import Fit, FitTarget, fit_to_template
from drapeline.rule_log import progress
from drapeline.storage import atomic_folder, load_npz, save_npz

_TABLES = "tables.npz"


class RemeshTable(NamedTuple):
    """Places of template vertices on a garment: corners (N, 3) int32, shares (N, 3) float32."""

    corners: np.ndarray
    shares: np.ndarray


def remesh(cloth: np.ndarray, table: RemeshTable) -> np.ndarray:
    """Move source vertices (..., V, 3) of any frame to the template's topology: (..., N, 3)."""
    return (cloth[..., table.corners, :] * table.shares[..., None]).sum(axis=-2)


def load_tables(folders: Iterable[str | Path]) -> dict[str, RemeshTable]:
    """Remesh tables of garments, by the name of their outfit or sample.

    Args:
        folders: written by `write_tables` for one type.

    Raises:
        InputError: a file is missing or a garment lacks one of the two arrays.
    """
    found = {}
    for folder in folders:
        path = Path(folder) / _TABLES
        arrays = load_npz(path, {"*/corners": "int * 3", "*/shares": "float * 3"})
        for name in dict.fromkeys(key.rpartition("/")[0] for key in arrays):
            for key in RemeshTable._fields:
                if f"{name}/{key}" not in arrays:
                    raise InputError(f"{path}: lacks {name}/{key}, expected it for every garment")
            found[name] = RemeshTable(*(arrays[f"{name}/{key}"] for key in RemeshTable._fields))
    return found


_BOUNDARY_M = 0.02
_TURN_M = 0.1  # a place may be this much further away if it faces a radian better
_REPAIRS = 20
_REPAIRS_PER_RING = 5


class Residual(NamedTuple):
    """Losses of a garment by its new topology, all but the last in millimetres."""

    original_to_remeshed_mm: float  # mean distance of the source's vertices from the new surface
    # Mean distance of the new surface's vertices, edge middles and face centres from the source.
    remeshed_to_original_mm: float
    # Mean distance from the new surface of source vertices within 2 cm of an opening.
    boundaries_mm: float
    flipped_faces: int  # faces of the new surface that are turned over, see `flipped_faces`


def remesh_table(fit: Fit) -> RemeshTable:
    """Find the closest place on the deformed source for each template vertex.

    Vertices of an opening or seam go to the source's. Where faces come out turned over, the
    vertices about them are moved to between their neighbours.

    Args:
        fit: of `fit_to_template`.
    """
    target = fit.target
    corners, shares = _closest(target.vertices, target.normals, fit.vertices, fit.triangles)
    # An armpit is a place to start from, too blunt for a vertex to be tied to it.
    seams = zip(target.guides, fit.guides, strict=True)
    lines = [(ids, line) for ids, line in seams if len(ids) > 1]
    lines += [(loop, _close(fit.loops[name])) for name, loop in target.loops.items()]
    for ids, line in lines:
        corners[ids], shares[ids] = _on_line(target.vertices[ids], fit.vertices, line)
    table = _repair_flips(RemeshTable(corners, shares), fit, target.template)
    return RemeshTable(table.corners.astype(np.int32), table.shares.astype(np.float32))


def _closest(
    points: np.ndarray, normals: np.ndarray, vertices: np.ndarray, triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Corners (P, 3) and shares (P, 3) of the closest places on faces that face the same way.

    Where the closest face looks the other way, the point goes to the closest vertex that does not.
    """
    (corners, shares), face = _closest_places(points, vertices, triangles)
    away = np.flatnonzero((face_normals(vertices, triangles[face]) * normals).sum(axis=1) <= 0)
    if len(away):
        owner = np.zeros(len(vertices), dtype=np.int64)
        owner[triangles] = np.arange(len(triangles))[:, None]
        own = vertex_normals(vertices, triangles)
        tree = cKDTree(np.hstack([vertices, _TURN_M * own]))
        _, near = tree.query(np.hstack([points[away], _TURN_M * normals[away]]))
        corners[away] = triangles[owner[near]]
        shares[away] = corners[away] == near[:, None]
    return corners, shares


def _closest_places(
    points: np.ndarray, vertices: np.ndarray, triangles: np.ndarray
) -> tuple[RemeshTable, np.ndarray]:
    """The closest places to points (P, 3), and the faces (P,) that hold them."""
    place, face = closest_points(points, vertices, triangles)
    corners = triangles[face].astype(np.int64)
    a, b, c = (np.ascontiguousarray(vertices[corners[:, k]]) for k in range(3))
    shares = np.clip(igl.barycentric_coordinates(place.astype(np.float64), a, b, c), 0, 1)
    shares = np.nan_to_num(shares, nan=1 / 3)
    return RemeshTable(corners, shares / shares.sum(axis=1, keepdims=True)), face


def _on_line(
    points: np.ndarray, vertices: np.ndarray, line: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Corners (P, 3), of which the last repeats the first, and shares of places on a line."""
    before, after = (line[:-1], line[1:]) if len(line) > 1 else (line, line)
    start = vertices[before]
    axis = vertices[after] - start
    gap = points[:, None] - start
    along = np.einsum("pei,ei->pe", gap, axis) / np.maximum((axis**2).sum(axis=1), 1e-20)
    along = np.clip(along, 0, 1)
    distance = ((gap - along[..., None] * axis) ** 2).sum(axis=-1)
    best = distance.argmin(axis=1)
    share = along[np.arange(len(points)), best]
    corners = np.stack([before[best], after[best], before[best]], axis=1)
    return corners, np.stack([1 - share, share, 0 * share], axis=1)


def _close(loop: np.ndarray) -> np.ndarray:
    return np.append(loop, loop[0])


def _repair_flips(table: RemeshTable, fit: Fit, template: GarmentTemplate) -> RemeshTable:
    """Move vertices about faces that are turned over to between their neighbours.

    Vertices of openings stay. Where moving the faces' own vertices is not enough, those around
    them move too. Returns the best table of all attempts.
    """
    graph = edge_graph(edges(template.faces), len(template.vertices))
    within = graph @ sp.diags((template.loop < 0).astype(float))
    own = vertex_normals(fit.rest, fit.triangles)
    best, least = table, np.inf
    for attempt in range(_REPAIRS):
        turned = flipped_faces(table, template.faces, fit.rest, fit.triangles)
        if turned.sum() < least:
            best, least = table, turned.sum()
        if not least:
            break
        moved = np.zeros(len(template.vertices), dtype=bool)
        moved[template.faces[turned]] = True
        for _ in range(attempt // _REPAIRS_PER_RING):
            moved |= graph @ moved > 0
        moved = np.flatnonzero(moved & (template.loop < 0))
        # At the point of a neckline the mean of all neighbours would lie beyond the cloth.
        around = (graph, within)[attempt % 2][moved]
        count = np.maximum(np.asarray(around.sum(axis=1)), 1)
        places, normals = (around @ remesh(values, table) / count for values in (fit.rest, own))
        corners, shares = table.corners.copy(), table.shares.copy()
        corners[moved], shares[moved] = _closest(places, normals, fit.rest, fit.triangles)
        table = RemeshTable(corners, shares)
    return best


def flipped_faces(
    table: RemeshTable, faces: np.ndarray, vertices: np.ndarray, triangles: np.ndarray
) -> np.ndarray:
    """(F,) bool, faces of a remeshed garment that are turned over.

    They look away, by more than 90 degrees, from the source's normal at the closest place and from
    its mean normal at their own corners. The first alone would count faces at the crotch, where the
    cloth closest through the air is that of the other leg. Normals are interpolated between
    vertices: at an edge, rounding would decide which face is the closest.

    Args:
        table: of `remesh_table`.
        faces: (F, 3) of the template.
        vertices, triangles: (V, 3) and (G, 3) of the source.
    """
    places = remesh(vertices, table)
    own = face_normals(places, faces)
    normals, middles = vertex_normals(vertices, triangles), places[faces].mean(axis=1)
    near = remesh(normals, _closest_places(middles, vertices, triangles)[0])
    corners = remesh(normals, table)[faces].sum(axis=1)
    return ((own * near).sum(axis=1) < 0) & ((own * corners).sum(axis=1) < 0)


def residual(
    vertices: np.ndarray, faces: np.ndarray, template: GarmentTemplate, table: RemeshTable
) -> Residual:
    """Measure how far a garment and its remeshed self lie apart.

    Args:
        vertices, faces: (V, 3) metres and (F, 3) or (F, 4) of the source.
        template: of its type.
        table: of `remesh_table`.
    """
    vertices = np.asarray(vertices, dtype=np.float64)
    triangles = triangulate(np.asarray(faces))
    new = remesh(vertices, table).astype(np.float64)
    place, _ = closest_points(vertices, new, template.faces)
    there = 1000 * np.linalg.norm(vertices - place, axis=1)
    pairs = edges(template.faces)
    sampled = np.concatenate([new, new[pairs].mean(axis=1), new[template.faces].mean(axis=1)])
    place, _ = closest_points(sampled, vertices, triangles)
    back = 1000 * np.linalg.norm(sampled - place, axis=1)
    boundary = vertices[np.concatenate(boundary_loops(triangles))]
    near, _ = cKDTree(boundary).query(vertices)
    return Residual(
        float(there.mean()),
        float(back.mean()),
        float(there[near < _BOUNDARY_M].mean()),
        int(flipped_faces(table, template.faces, vertices, triangles).sum()),
    )


_UNITS = {"mm": "mm", "faces": "count"}


class NamedGarment(NamedTuple):
    """A garment in the rest pose."""

    name: str  # of its outfit or sample
    garment: str
    # vertices, faces: (V, 3) metres, root frame, and (F, 3) or (F, 4).
    vertices: np.ndarray
    faces: np.ndarray


def garments_at_rest(shard: str | Path, *, simulated: bool) -> list[NamedGarment]:
    """Garments of a shard in the rest pose.

    Args:
        shard: of simulated samples, of which only accepted ones count; or of outfits at rest.
        simulated: which of the two.

    Raises:
        InputError: a file is missing or damaged.
    """
    if simulated:
        return [garment for sample in samples_of([shard]) for garment in _of_sample(sample)]
    return [
        NamedGarment(name, garment.name, garment.vertices, garment.faces)
        for name, _, outfit in load_static(shard)
        for garment in outfit.garments
    ]


def _of_sample(folder: Path) -> list[NamedGarment]:
    if not read_record(folder).accepted:
        return []
    with Sample(folder) as sample:
        meshes = {name: sample.mesh(name) for name in sample.garments}
        return [
            NamedGarment(sample.id, name, mesh.vertices, mesh.faces)
            for name, mesh in meshes.items()
        ]


def write_tables(
    folder: str | Path,
    garments: Iterable[NamedGarment],
    garment: str,
    template: GarmentTemplate,
    settings: TemplateFitSettings,
) -> int:
    """Register garments and write `tables.npz` of remesh tables, and `metrics.tsv` of residuals.

    Args:
        folder: replaced as a whole.
        garments: of which those of other types are ignored.
        garment: the type.
        template: of it.

    Returns:
        Number of garments registered.

    Raises:
        InputError: names the outfit whose garment cannot be registered.
    """
    wanted, target = [one for one in garments if one.garment == garment], FitTarget(template)
    tables: dict[str, np.ndarray] = {}
    errors: list[dict[str, Any]] = []
    for name, _, vertices, faces in progress(wanted, label="garments"):
        try:
            table = remesh_table(fit_to_template(vertices, faces, target, settings))
        except InputError as error:
            raise InputError(f"{name}/{garment}: {error}") from error
        tables |= {f"{name}/{key}": value for key, value in table._asdict().items()}
        left = residual(vertices, faces, template, table)
        errors += error_rows(garment, name, _measures(left))
    with atomic_folder(folder) as scratch:
        save_npz(scratch / _TABLES, **tables)
        write_errors(scratch / FILE_NAME, errors)
    return len(wanted)


def _measures(left: Residual) -> list[Measure]:
    return [
        Measure(name, float(value), _UNITS[name.rpartition("_")[2]])
        for name, value in left._asdict().items()
    ]
