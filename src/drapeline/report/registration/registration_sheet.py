"""Figures 5 and 7 of CLOTH3D: garments, laid on the body, and rebuilt from offsets."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import rest_body
from drapeline.dataset.scene_part import BODY_COLOUR
from drapeline.geometry.mesh import faces_within, triangulate, vertex_normals
from drapeline.outfits.garment_types import first_of_each
from drapeline.outfits.outfit import Garment
from drapeline.outfits.static import StaticOutfit
from drapeline.registration.to_body.registrar import Registrar, Registration
from drapeline.registration.to_body.round_trip import surface_distance
from drapeline.registration.to_body.topology import Topology
from drapeline.rendering.camera import Camera, look_at
from drapeline.rendering.picture_grid import GridCell, heat_parts, save_grid
from drapeline.rendering.raytracer import ColouredMesh, raytrace

_SIZE = (320, 340)
_CLOTH, _LAID, _REBUILT = (0.33, 0.5, 0.74), (0.84, 0.6, 0.3), (0.4, 0.62, 0.5)
_FLOAT_M = 0.004  # garments laid on the body are shown this far above it
_SCALE_MM = 5.0


def plot_registration(
    path: str | Path,
    topology: Topology,
    bodies: Mapping[str, BodyModel],
    outfits: Iterable[StaticOutfit],
) -> None:
    """Write a PNG with a row per garment type: garment, registered, rebuilt, errors.

    Args:
        path: the PNG.
        topology: of the super-resolved body.
        bodies: super-resolved, by gender.
        outfits: the first garment of each type among them is shown.
    """
    registrar = Registrar(topology)
    rows, labels = [], []
    worn = ((g.name, (g, outfit)) for _, _, outfit in outfits for g in outfit.garments)
    for garment, outfit in first_of_each(worn):
        body = rest_body(bodies[outfit.gender], outfit.shape)
        done = registrar.register(garment.name, garment.vertices, garment.faces, body)
        rows.append(_row(garment, body, topology, done))
        labels.append(garment.name)
    columns = ("garment", "registered to the body", "rebuilt", "error of the garment")
    save_grid(path, rows, columns=columns, labels=labels, heat_mm=_SCALE_MM)


def _row(
    garment: Garment, body: np.ndarray, topology: Topology, done: Registration
) -> list[GridCell]:
    faces, triangles = topology.faces_of(garment.name), triangulate(garment.faces)
    laid = done.laid + _FLOAT_M * vertex_normals(done.laid, triangles)
    vertices, kept = body + done.offsets, faces_within(faces, done.match.mask)
    error, _, _ = surface_distance(garment.vertices.astype(float), triangles, vertices, kept)
    values = {m.metric: m.value for m in done.measures}
    wearer = ColouredMesh(body, topology.faces, BODY_COLOUR)
    views = [
        ([wearer, ColouredMesh(garment.vertices, garment.faces, _CLOTH)], ""),
        ([wearer, ColouredMesh(laid, triangles, _LAID)], ""),
        ([wearer, ColouredMesh(vertices, kept, _REBUILT)], ""),
        (
            [wearer, *heat_parts(garment.vertices, triangles, 1000 * error, _SCALE_MM)],
            f"mean {values['garment_to_rebuilt_mean_mm']:.2f} mm,"
            f" at most {values['garment_to_rebuilt_max_mm']:.1f} mm",
        ),
    ]
    camera = _camera(body)
    lift = -body[:, 2].min()
    return [
        GridCell(raytrace([_lift(p, lift) for p in parts], camera, samples=12), caption)
        for parts, caption in views
    ]


def _lift(part: ColouredMesh, height: float) -> ColouredMesh:
    return ColouredMesh(part.vertices + [0, 0, height], part.faces, part.colour)


def _camera(body: np.ndarray) -> Camera:
    height = float(np.ptp(body[:, 2]))
    return look_at(
        np.array([0.0, -4.6, 1.25 * height / 1.5]),
        np.array([0.0, 0.0, 0.5 * height]),
        focal_px=2.3 * _SIZE[1] * 1.5 / max(height, 1.5),
        size=_SIZE,
    )
