"""Sheets of cloth on a moving body, by a cloth solver instead of skinning.

What trained models decode is cloth at rest. Skinning carries it along with the limbs next to it, so
that a skirt follows a shin that is bent back; a solver lets it hang, swing and fold.
"""

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import igl
import numpy as np
from scipy.spatial import KDTree

from drapeline.bodies.follow import pose_body
from drapeline.bodies.model import BodyModel
from drapeline.bodies.sequence import BodySequence
from drapeline.errors import InputError
from drapeline.frames import GENDERS, REST_POSE
from drapeline.geometry.mesh import Mesh, boundary_edges, mean_edge_length
from drapeline.geometry.point_cache import PointCache
from drapeline.outfits.garment_types import GARMENT_TYPES
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.outfits.worn import wear_in_layers
from drapeline.simulation.attempts import SimulationSettings
from drapeline.simulation.health import HealthBounds
from drapeline.simulation.simulate import DressedBody, simulate_outfit
from drapeline.simulation.solver import ClothSolver

_FABRIC = "cotton"
_BAND_M = 0.02  # width of a waistband
_SLANT_M = 0.06  # from the highest to the lowest point of a waist


def simulate_sheets(
    sheets: Mapping[str, Mesh],
    body: BodyModel,
    record: BodySequence,
    solver: ClothSolver,
    *,
    edge_length_m: float,
    simulation: SimulationSettings,
    bounds: HealthBounds,
) -> dict[str, list[Mesh]]:
    """Sheets in every frame of a motion.

    Trousers and skirts are held at their waist, and nothing else is; all cloth is cotton.

    Args:
        sheets: garment type -> triangles at rest on the wearer, root-relative metres, Z up, from
            the innermost to the outermost.
        body: of the wearer.
        record: the wearer in motion.
        solver: moves the cloth.
        edge_length_m: sheets with shorter edges are made coarser first.
        simulation, bounds: as of samples.

    Returns:
        Garment type -> N sheets, root-relative metres, perhaps of fewer vertices than at rest.

    Raises:
        InputError: there is no sheet, one has no faces, or the simulation is out of bounds.
    """
    empty = [name for name, sheet in sheets.items() if not len(sheet.faces)]
    if empty or not sheets:
        raise InputError(f"{' and '.join(empty) or 'sheets'}: no faces, expected cloth to simulate")
    at_rest = pose_body(body, record.shape, REST_POSE, np.zeros(3))
    layers = wear_in_layers(list(sheets.values()), at_rest)
    garments = tuple(
        _garment(name, _coarsen(sheet, edge_length_m))
        for name, sheet in zip(sheets, layers, strict=True)
    )
    even = np.zeros(2)  # the sheets are made for the wearer, not for a tighter or wider body
    outfit = Outfit(garments, record.shape, even, even, GENDERS[record.gender])
    with TemporaryDirectory() as name:
        folder = Path(name) / "simulated"
        dressed = DressedBody(body, record, outfit)
        status = simulate_outfit(folder, dressed, solver, settings=simulation, bounds=bounds)
        if status["status"] != "accepted":
            raise InputError(f"{' and '.join(sheets)}: {status['reason']}")
        return {one.name: _frames(folder, one) for one in garments}


def _coarsen(sheet: Mesh, edge_length_m: float) -> Mesh:
    """A sheet whose edges are not much shorter; the shortest ones are collapsed first."""
    share = (mean_edge_length(sheet.vertices, sheet.faces) / edge_length_m) ** 2
    wanted = round(share * len(sheet.faces))
    if wanted >= len(sheet.faces):
        return sheet
    vertices, faces = np.asarray(sheet.vertices, np.float64), np.asarray(sheet.faces, np.int64)
    coarse, corners, *_ = igl.decimate(vertices, faces, wanted)
    return Mesh(coarse, corners.astype(np.int32)) if len(corners) else sheet


def _garment(name: str, sheet: Mesh) -> Garment:
    vertices = sheet.vertices.astype(np.float32)
    held, loose = (np.zeros(len(vertices), dtype=np.float32) for _ in range(2))
    rim = vertices[np.unique(boundary_edges(sheet.faces))]
    if GARMENT_TYPES[name].region == "lower" and len(rim):
        waist = rim[rim[:, 2] > rim[:, 2].max() - _SLANT_M]
        held[KDTree(waist).query(vertices)[0] <= _BAND_M] = 1
    no_uv = np.zeros((1, 2), dtype=np.float32), np.zeros_like(sheet.faces)
    return Garment(name, vertices, sheet.faces, *no_uv, held, loose, {"fabric": _FABRIC})


def _frames(folder: Path, garment: Garment) -> list[Mesh]:
    with PointCache(folder / f"{garment.name}.f32", len(garment.vertices)) as cache:
        return [Mesh(places, garment.faces) for places in cache.frames(0, len(cache))]
