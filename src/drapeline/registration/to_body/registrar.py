"""Garments become offsets: laid onto the body, matched with it, and measured on the way back."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import rest_body
from drapeline.bodies.weight_transfer import nearest_weights
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import read_record
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.geometry.closest import closest_points
from drapeline.geometry.mesh import (
    boundary_edges,
    edge_graph,
    face_normals,
    faces_within,
    triangulate,
    vertex_normals,
)
from drapeline.outfits.garment_types import GARMENTS, SKIRTS, weight_reach_m
from drapeline.outfits.static import StaticOutfit
from drapeline.registration.error_table import FILE_NAME, Measure, error_rows, write_errors
from drapeline.registration.to_body.correspondence import BodyMesh, Correspondence, correspond
from drapeline.registration.to_body.dynamic_offsets import SampleGarment
from drapeline.registration.to_body.nicp import NicpSettings, TargetSurface, fit_to_surface
from drapeline.registration.to_body.skirt_tube import SkirtTube
from drapeline.registration.to_body.topology import Topology
from drapeline.rule_log import progress
from drapeline.storage import atomic_folder, write_json

_TURNED_OVER = -0.2  # cosine between the normals of cloth and body
_FALL_M2 = 0.008  # least area of what is turned over; collars have 0.02 and more
_COLLAR_M = 0.2  # below the highest cloth
LOST_M = 0.01  # garment further than this from what is rebuilt counts as lost


def surface_distance(
    vertices: np.ndarray, triangles: np.ndarray, other: np.ndarray, other_triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances from the faces of one surface to the closest points of another.

    Args:
        vertices, triangles: (V, 3) and (F, 3) measured from, at the middles of faces.
        other, other_triangles: the surface measured to.

    Returns:
        Distances (F,) in metres, angles (F,) in degrees between the normals, and areas (F,) in
        square metres to weigh them by.
    """
    middles = vertices[triangles].mean(axis=1)
    place, face = closest_points(middles, other, other_triangles)
    distance = np.linalg.norm(place - middles, axis=1)
    own, their = face_normals(vertices, triangles), face_normals(other, other_triangles)[face]
    angle = np.degrees(np.arccos(np.clip((own * their).sum(1), -1, 1)))
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    return distance, angle, np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def round_trip(
    garment: np.ndarray,
    triangles: np.ndarray,
    body: np.ndarray,
    faces: np.ndarray,
    match: Correspondence,
) -> list[Measure]:
    """Errors of garment -> offsets -> garment, means weighted by area.

    `area_lost_percent` is the share of the garment's area that lies further than `LOST_M` from
    what is rebuilt. Holes are openings that the garment does not have, islands are loose pieces;
    both are counted before the mask is cleaned, and after.

    Args:
        garment: (C, 3) in the rest pose, metres.
        triangles: (G, 3) of the garment.
        body: (V, 3) that it was registered on.
        faces: (F, 3) of the body's topology.
    """
    vertices, kept = body + match.offsets(garment, body), faces_within(faces, match.mask)
    forward, angle, area = surface_distance(garment, triangles, vertices, kept)
    backward, _, kept_area = surface_distance(vertices, kept, garment, triangles)
    openings, pieces = _openings(kept), _pieces(kept)
    return [
        Measure("garment_to_rebuilt_mean_mm", 1e3 * np.average(forward, weights=area), "mm"),
        Measure("garment_to_rebuilt_max_mm", 1e3 * forward.max(), "mm"),
        Measure("rebuilt_to_garment_mean_mm", 1e3 * np.average(backward, weights=kept_area), "mm"),
        Measure("rebuilt_to_garment_max_mm", 1e3 * backward.max(), "mm"),
        Measure("normal_error_deg", np.average(angle, weights=area), "deg"),
        Measure("area_lost_percent", 100 * area[forward > LOST_M].sum() / area.sum(), "percent"),
        Measure("holes_before", match.holes, "count"),
        Measure("islands_before", match.islands, "count"),
        Measure("holes_after", max(openings - _openings(triangles), 0), "count"),
        Measure("islands_after", pieces - _pieces(triangles), "count"),
    ]


def _openings(triangles: np.ndarray) -> int:
    """Number of loops that the boundary consists of."""
    return _count_pieces(boundary_edges(triangles))


def _pieces(triangles: np.ndarray) -> int:
    return _count_pieces(triangles[:, [0, 1, 0, 2]].reshape(-1, 2))


def _count_pieces(pairs: np.ndarray) -> int:
    if not len(pairs):
        return 0
    used = np.zeros(pairs.max() + 1, dtype=bool)
    used[pairs] = True
    _, label = connected_components(edge_graph(pairs, len(used)), directed=False)
    return len(np.unique(label[used]))


class RegisteredGarment(NamedTuple):
    """One garment on one body."""

    laid: np.ndarray  # (C, 3) the garment deformed onto the body
    match: Correspondence  # body vertices and their points on the garment
    offsets: np.ndarray  # (V, 3) float32 metres
    measures: list[Measure]


class Registrar:
    """Registers garments of all types on super-resolved bodies of all shapes."""

    def __init__(self, topology: Topology) -> None:
        self.topology = topology
        self._settings = NicpSettings()
        count = len(topology.rest)
        self._body = BodyMesh(topology.faces, count)
        self._skirt = BodyMesh(topology.skirt_faces, count)

    @cached_property
    def _tube(self) -> SkirtTube:
        return SkirtTube(self.topology)

    def register(
        self, name: str, vertices: np.ndarray, faces: np.ndarray, body: np.ndarray
    ) -> RegisteredGarment:
        """Register one garment, but for what is folded over it, such as the fall of a collar.

        Args:
            name: its type, one of `GARMENTS`.
            vertices: (C, 3) in the rest pose, metres.
            faces: (F, 3) or (F, 4).
            body: (V, 3) super-resolved body of the wearer's shape in the rest pose.

        Raises:
            InputError: no body vertex lies under the garment.
        """
        garment = np.asarray(vertices, dtype=np.float64)
        triangles = _single_layer(garment, triangulate(faces), body, self._body.faces)
        mesh, target = self._body, body
        if name in SKIRTS:
            mesh = self._skirt
            target = self._tube(body, garment, np.unique(boundary_edges(triangles)))
        surface = TargetSurface(target, mesh.faces, self._settings.turn_m)
        used, corners = np.unique(triangles, return_inverse=True)
        corners = corners.reshape(triangles.shape)
        laid = garment.copy()
        laid[used] = fit_to_surface(garment[used], corners, surface, self._settings)
        match = correspond(target, mesh, laid, triangles)
        if not match.mask.any():
            raise InputError(f"{name}: covers no part of the body, expected a garment in its place")
        measures = round_trip(garment, triangles, body, mesh.faces, match)
        return RegisteredGarment(laid, match, match.offsets(garment, body), measures)


def _single_layer(
    garment: np.ndarray, triangles: np.ndarray, body: np.ndarray, faces: np.ndarray
) -> np.ndarray:
    """Triangles (G, 3) without those at the top that lie on the body with their inner side out."""
    there, middles = np.unique(faces), garment[triangles].mean(axis=1)
    _, nearest = KDTree(body[there]).query(middles)
    out = vertex_normals(body, faces)[there[nearest]]
    turned = (face_normals(garment, triangles) * out).sum(axis=1) < _TURNED_OVER
    turned &= middles[:, 2] > middles[:, 2].max() - _COLLAR_M
    chosen = triangles[turned]
    # Necklines and straps that stand off a little turn a triangle here and there.
    pairs = chosen[:, [0, 1, 0, 2]].reshape(-1, 2)
    _, piece = connected_components(edge_graph(pairs, len(garment)), directed=False)
    sides = garment[chosen[:, 1:]] - garment[chosen[:, :1]]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2
    folded = np.bincount(piece[chosen[:, 0]], area, len(piece))[piece[chosen[:, 0]]] > _FALL_M2
    turned[turned] = folded
    return triangles[~turned]


def register_shard(
    registrar: Registrar, outfits: Sequence[StaticOutfit], bodies: Mapping[str, BodyModel]
) -> tuple[dict[str, np.ndarray], list[dict[str, Any]]]:
    """Register all garments of static outfits.

    Args:
        registrar: of the bodies' topologies.
        outfits: as `load_static` reads them.
        bodies: super-resolved, by gender.

    Returns:
        Arrays with a row per garment (`offsets`, `mask`, `shape`, `gender`, `tightness`,
        `garment`, `outfit`, `split`), and rows of the table of errors.

    Raises:
        InputError: names the outfit whose garment cannot be registered.
    """
    rows: list[tuple] = []
    errors: list[dict[str, Any]] = []
    for name, split, outfit in progress(outfits, label="outfits"):
        body = rest_body(bodies[outfit.gender], outfit.shape)
        for garment in outfit.garments:
            try:
                done = registrar.register(garment.name, garment.vertices, garment.faces, body)
            except InputError as error:
                raise InputError(f"outfit {name}: {error}") from error
            rows.append(
                (
                    done.offsets,
                    done.match.mask,
                    outfit.shape.astype(np.float32),
                    np.int8(GENDERS.index(outfit.gender)),
                    outfit.signed_tightness.astype(np.float32),
                    np.int8(GARMENTS.index(garment.name)),
                    name,
                    split,
                )
            )
            errors += error_rows(garment.name, name, done.measures)
    keys = ("offsets", "mask", "shape", "gender", "tightness", "garment", "outfit", "split")
    columns = zip(*rows, strict=True)
    return {key: np.array(column) for key, column in zip(keys, columns, strict=True)}, errors


def register_sample(
    output: str | Path, sample: str | Path, registrar: Registrar, bodies: Mapping[str, BodyModel]
) -> str:
    """Register the garments of one sample in their rest pose.

    Args:
        output: folder for `{Garment}.npz`, `metrics.tsv` and `status.json`; of a rejected sample
            only the last is written.
        sample: folder as `write_sample` leaves it.
        registrar: on the topology of the super-resolved body.
        bodies: super-resolved, by gender.

    Returns:
        The sample's status, "accepted" or "rejected".

    Raises:
        InputError: a file of the sample is unusable, or a garment covers no part of the body.
    """
    record = read_record(sample)
    status = {key: record.meta[key] for key in ("id", "status", "reason", "split")}
    with atomic_folder(output) as scratch:
        write_json(scratch / "status.json", status)
        if record.accepted:
            _register(scratch, Path(sample), registrar, bodies)
    return status["status"]


def _register(
    folder: Path, sample: Path, registrar: Registrar, bodies: Mapping[str, BodyModel]
) -> None:
    errors, topology = [], registrar.topology
    with Sample(sample) as sequence:
        model = bodies[sequence.gender]
        body = rest_body(model, sequence.info.shape)
        for name in sequence.garments:
            mesh = sequence.mesh(name)
            done = registrar.register(name, mesh.vertices, mesh.faces, body)
            faces = faces_within(topology.faces_of(name), done.match.mask)
            vertex = np.flatnonzero(done.match.mask).astype(np.int32)
            points = body + done.offsets
            weights = nearest_weights(
                points,
                faces,
                body,
                topology.faces,
                model.weights,
                reach_m=weight_reach_m(name),
            )
            SampleGarment(
                mask=done.match.mask,
                vertex=vertex,
                corner=done.match.corner[vertex],
                bary=done.match.bary[vertex],
                offsets=done.offsets,
                weights=weights[vertex],
            ).save(folder / f"{name}.npz")
            errors += error_rows(name, sequence.id, done.measures)
    write_errors(folder / FILE_NAME, errors)
