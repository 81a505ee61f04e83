"""Garments that were found in a scan, moved to its points."""

from collections.abc import Mapping

import numpy as np

from drapeline.bodies.follow import PosedBody
from drapeline.dataset.segmented_scans import SegmentedScan
from drapeline.geometry.mesh import Mesh, vertex_normals
from drapeline.outfits.garment_types import LABELS
from drapeline.outfits.worn import stack_layers
from drapeline.registration.settings import RefineSettings
from drapeline.registration.to_points import fit_to_points

_POINTS = 4000  # of a garment that count
# Single frames have noise, and cloth that is finer than Garment4D's templates follows it.
SCAN_REFINING = RefineSettings(bend=4.0)


def move_to_scan(
    posed: Mapping[str, Mesh],
    rest: Mapping[str, Mesh],
    scan: SegmentedScan,
    body: PosedBody,
    settings: RefineSettings = SCAN_REFINING,
) -> dict[str, Mesh]:
    """Garments close to their points, with the lengths that they have at rest, and in layers.

    No garment becomes longer or shorter in this way: what its code got wrong in its cut stays.

    Args:
        posed: garment type -> triangles in the scan's world, from the innermost to the outermost;
            some may have no faces.
        rest: the same triangles at rest.
        scan: with the garments.
    """
    normals = vertex_normals(body.posed, body.faces)
    moved = {}
    for name, mesh in posed.items():
        own = np.flatnonzero(scan.labels == LABELS.index(name))
        points = scan.points[own[:: max(len(own) // _POINTS, 1)]]
        if len(mesh.faces) and len(points):
            vertices = fit_to_points(
                mesh.vertices[None],
                points[None],
                np.ones((1, len(points)), dtype=bool),
                mesh.faces,
                rest[name].vertices,
                body.posed[None],
                normals[None],
                settings,
            )
            mesh = Mesh(vertices[0], mesh.faces)
        moved[name] = mesh
    return dict(zip(moved, stack_layers([*moved.values()], body), strict=True))
