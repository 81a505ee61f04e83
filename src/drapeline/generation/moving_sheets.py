"""Sheets of cloth on a moving body, by a cloth solver instead of skinning.

What trained models decode is cloth at rest. Skinning carries it along with the limbs next to it, so
that a skirt follows a shin that is bent back; a solver lets it hang, swing and fold.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import igl
import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from drapeline.bodies.animation import make_body_sequence
from drapeline.bodies.follow import pose_body
from drapeline.bodies.model import BodyModel
from drapeline.bodies.sequence import BodySequence
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import Mesh, boundary_edges, mean_edge_length
from drapeline.geometry.point_cache import PointCache
from drapeline.job import Job
from drapeline.outfits.fabrics import FABRICS
from drapeline.outfits.garment_types import GARMENT_TYPES
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.outfits.worn import DrapedSheet, stack_layers
from drapeline.rule_log import LOGGER
from drapeline.simulation.settings import HealthBounds, SimulationSettings
from drapeline.simulation.simulate import DressedBody, simulate_outfit
from drapeline.simulation.solver import ClothSolver

_FABRIC = next(iter(FABRICS))  # cotton
_BAND_M = 0.02  # width of a waistband
_SLANT_M = 0.06  # from the highest to the lowest point of a waist
_UP = np.array([0.0, 0.0, 1.0])
# Decoded garments may touch themselves and their wearer; beyond this, cloth has come undone.
WORN = HealthBounds(
    inside_open_mean=0.03,
    inside_open_max=0.1,
    depth_m=0.06,
    stretch_low=0.7,
    stretch_high=1.4,
    slip_m=1.0,
    layer_share_mean=0.5,
    self_share_mean=0.5,
)


class SimulatedSheet(NamedTuple):
    """A sheet in motion."""

    rest: Mesh  # as the simulation began with it, at rest
    frames: list[Mesh]  # the same cloth in each frame of the motion


def simulate_sheets(
    sheets: Mapping[str, Mesh],
    body: BodyModel,
    record: BodySequence,
    solver: ClothSolver,
    *,
    edge_length_m: float | None,
    simulation: SimulationSettings,
    bounds: HealthBounds,
) -> dict[str, SimulatedSheet]:
    """Sheets in every frame of a motion.

    Trousers and skirts are held at their waist, and nothing else is; all cloth is cotton.

    Args:
        sheets: garment type -> triangles at rest on the wearer, root-relative metres, Z up, from
            the innermost to the outermost.
        edge_length_m: sheets with shorter edges are made coarser first; None leaves all as they
            are.

    Returns:
        Garment type -> sheet in N frames, root-relative metres, perhaps with fewer vertices than
        were given.

    Raises:
        InputError: there is no sheet, one has no faces, or the simulation is out of bounds.
    """
    empty = [name for name, sheet in sheets.items() if not len(sheet.faces)]
    if empty or not sheets:
        raise InputError(f"{' and '.join(empty) or 'sheets'}: no faces, expected cloth to simulate")
    at_rest = pose_body(body, record.shape, REST_POSE, np.zeros(3))
    layers = stack_layers(list(sheets.values()), at_rest)
    garments = tuple(
        _garment(name, sheet if edge_length_m is None else _coarsen(sheet, edge_length_m))
        for name, sheet in zip(sheets, layers, strict=True)
    )
    even = np.zeros(2)  # the sheets are made for the wearer, not for a tighter or wider body
    outfit = Outfit(garments, record.shape, even, even, record.gender)
    settings = simulation.replace(shape_frames=1)  # the body's shape stays
    return move_outfit(DressedBody(body, record, outfit), solver, settings, bounds)


def move_outfit(
    dressed: DressedBody,
    solver: ClothSolver,
    settings: SimulationSettings,
    bounds: HealthBounds,
) -> dict[str, SimulatedSheet]:
    """Garments in every frame of their wearer's motion, by name.

    Args:
        dressed: whom and what.
        solver: moves the cloth.
        settings, bounds: as of samples.

    Raises:
        InputError: the simulation is out of bounds.
    """
    garments = dressed.outfit.garments
    with TemporaryDirectory() as name:
        folder = Path(name) / "simulated"
        status = simulate_outfit(folder, dressed, solver, settings=settings, bounds=bounds)
        if status["status"] != "accepted":
            names = " and ".join(one.name for one in garments)
            raise InputError(f"{names}: {status['reason']}")
        return {
            one.name: SimulatedSheet(Mesh(one.vertices, one.faces), _frames(folder, one))
            for one in garments
        }


def simulate_sheet(
    sheet: Mesh, name: str, body: BodyModel, record: BodySequence, solver: ClothSolver, **how: Any
) -> list[Mesh]:
    """A sheet of the garment type `name` in every frame of a motion, see `simulate_sheets`.

    None, and a warning in the log, if the simulation is out of bounds.
    """
    try:
        return simulate_sheets({name: sheet}, body, record, solver, **how)[name].frames
    except InputError as error:
        LOGGER.warning("skinned, not simulated: %s", error)
        return []


def make_draper(
    solver: ClothSolver, frames: int, *, edge_length_m: float, simulation: Mapping[str, Any]
) -> "SolverDraper | None":
    """A `SolverDraper` with settings of simulations as in the config; None for no frames."""
    if not frames:
        return None
    return SolverDraper(solver, frames, edge_length_m, SimulationSettings(**simulation))


@dataclass(frozen=True)
class SolverDraper:
    """Drapes sheets on people in one pose: from rest they go along into it, and wait there."""

    solver: ClothSolver
    frames: int  # for which it hangs in the pose
    edge_length_m: float  # sheets with shorter edges are made coarser first
    # As of samples; there is a single attempt, and no floor, since the person may be in the air.
    simulation: SimulationSettings

    def __call__(
        self,
        sheets: Mapping[str, Mesh],
        body: BodyModel,
        gender: str,
        shape: np.ndarray,
        pose: np.ndarray,
        trans: np.ndarray,
        up: np.ndarray,
    ) -> dict[str, DrapedSheet]:
        """Sheets as they hang on a person; none if the simulation failed, which is logged.

        Args:
            sheets: see `simulate_sheets`; those without faces are left out.
            gender: "female" or "male".
            shape: (10,) of the wearer.
            pose: (72,) axis-angle, rad; its root rotation leads to the world.
            trans: (3,) the root joint there, metres.
            up: (3,) direction in the world.
        """
        sheets = {name: sheet for name, sheet in sheets.items() if len(sheet.faces)}
        if not sheets:
            return {}
        upright = _turn_between(up, _UP)
        turned = np.array(pose, dtype=np.float64)
        turned[:3] = (upright * Rotation.from_rotvec(turned[:3])).as_rotvec()
        still = np.tile(turned, (self.frames, 1)), np.zeros((self.frames, 3))
        record = make_body_sequence(body, shape, *still, gender=gender)
        try:
            if not np.array_equal(record.shape, shape):
                raise InputError("the body overlaps itself")
            moved = simulate_sheets(
                sheets,
                body,
                record,
                self.solver,
                edge_length_m=self.edge_length_m,
                simulation=self.simulation.replace(attempts=1, floor=False),
                bounds=WORN,
            )
        except InputError as error:
            LOGGER.info("skinned, not draped: %s", error)
            return {}
        return {
            name: DrapedSheet(
                sheet.rest,
                Mesh(
                    (upright.inv().apply(sheet.frames[-1].vertices) + trans).astype(np.float32),
                    sheet.rest.faces,
                ),
            )
            for name, sheet in moved.items()
        }


def _turn_between(start: np.ndarray, end: np.ndarray) -> Rotation:
    """The least turn from one direction (3,) to another."""
    start, end = (np.asarray(way, np.float64) / np.linalg.norm(way) for way in (start, end))
    axis = np.cross(start, end)
    sine, cosine = np.linalg.norm(axis), start @ end
    if sine < 1e-9:  # any axis across will do
        axis = np.cross(start, np.eye(3)[np.abs(start).argmin()])
    return Rotation.from_rotvec(axis / np.linalg.norm(axis) * np.arctan2(sine, cosine))


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
        waist = rim[rim[:, 2] > float(rim[:, 2].max()) - _SLANT_M]
        held[KDTree(waist).query(vertices)[0] <= _BAND_M] = 1
    no_uv = np.zeros((1, 2), dtype=np.float32), np.zeros_like(sheet.faces)
    return Garment(name, vertices, sheet.faces, *no_uv, held, loose, loose, {"fabric": _FABRIC})


def _frames(folder: Path, garment: Garment) -> list[Mesh]:
    with PointCache(folder / f"{garment.name}.f32", len(garment.vertices)) as cache:
        return [Mesh(places, garment.faces) for places in cache.frames(0, len(cache))]


def job_draper(job: Job, frames: int) -> SolverDraper | None:
    """What lets garments hang in a job that is told of a `solver`'s module and of `hanging`.

    Args:
        job: with these params.
        frames: for which they hang; 0 gives None.
    """
    solver = import_module(job.params.solver).cloth_solver(job.threads)
    return make_draper(solver, frames, **job.params.hanging)
