"""A person in motion, dressed and simulated, without a workflow."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from drapeline.bodies.animation import make_body_sequence
from drapeline.bodies.model import BodyModel, free_body, load_body
from drapeline.bodies.sequence import BodySequence, body_sequence_vertices
from drapeline.dataset.info_mat import SampleInfo
from drapeline.dataset.writer import GarmentAnimation, write_reconstruction
from drapeline.errors import InputError
from drapeline.experiment.cloth_solvers import CLOTH_SOLVERS, QUICK_SOLVER
from drapeline.frames import GENDERS
from drapeline.generation.moving_sheets import SimulatedSheet, move_outfit, simulate_sheets
from drapeline.geometry.mesh import Mesh
from drapeline.motions.motion import Motion, check_motion, resample
from drapeline.outfits.garment_types import GARMENTS, OUTFIT_TYPES, removable_limbs
from drapeline.outfits.generate import sample_outfit
from drapeline.outfits.templates import build_templates
from drapeline.seeding import rng_for
from drapeline.simulation.settings import HealthBounds, SimulationSettings
from drapeline.simulation.simulate import DressedBody
from drapeline.simulation.solver import ClothSolver


@dataclass(frozen=True)
class SimulatedOutfit:
    """Somebody in motion, and the clothes; all vertices are relative to the root joint.

    Attributes:
        gender: "female" or "male".
        shape: (10,) of the wearer.
        poses: (F, 72) axis-angle, rad, at 30 frames per second.
        trans: (F, 3) root joint in the world, metres, Z up; added to vertices, they are there.
        garments: garment type -> its mesh at rest (`rest`), and one in each frame (`frames`),
            metres, from the innermost to the outermost.
        body: the wearer in each frame, metres.
        model: the wearer's, in SMPL's format.
    """

    gender: str
    shape: np.ndarray
    poses: np.ndarray
    trans: np.ndarray
    garments: dict[str, SimulatedSheet]
    body: list[Mesh]
    model: BodyModel

    @classmethod
    def of(
        cls, garments: dict[str, SimulatedSheet], model: BodyModel, record: BodySequence
    ) -> "SimulatedOutfit":
        """Garments that move with a body."""
        return cls(
            gender=record.gender,
            shape=record.shape,
            poses=record.poses,
            trans=record.trans,
            garments=garments,
            body=[Mesh(frame, model.faces) for frame in body_sequence_vertices(model, record)],
            model=model,
        )


def simulate(
    outfit: str | Mapping[str, Mesh],
    motion: Motion,
    body: BodyModel | str | Path | None = None,
    *,
    gender: str = "female",
    shape: Sequence[float] | np.ndarray | None = None,
    solver: str | ClothSolver | None = None,
    edge_length_m: float = 0.02,
    seed: int = 0,
    settings: Mapping[str, Any] | None = None,
    bounds: Mapping[str, Any] | None = None,
) -> SimulatedOutfit:
    """Dress somebody, and move the clothes with the body by a cloth solver (CLOTH3D 3).

    The body is put on the motion and freed of self-collisions first, as in samples of a dataset.

    Args:
        outfit: garment types joined by "+", such as "Tshirt+Trousers" or "Dress", of which a
            random outfit is made; or garment type -> mesh at rest on this very body (pose of
            `SmplicitModel.decode`), root-relative metres, Z up, from the innermost to the
            outermost. Meshes are taken for cotton, and held at the waist of trousers and skirts.
        motion: as `import_motion` gives it; one of another rate is resampled to 30 frames per
            second.
        body: a body in SMPL's format, or its file; the free one of the gender if None.
        gender: "female" or "male".
        shape: (10,) of the wearer; the mean body if None. One that overlaps itself in the motion
            is made thinner, if the outfit is made for it.
        solver: name of one in a config (`simulation.solver`), or anything that fulfils
            `ClothSolver`; None takes the fastest.
        edge_length_m: mean edge of random outfits; meshes with shorter edges are made coarser.
        seed: of a random outfit.
        settings: those of `simulation.settings` in a config that are not the defaults.
        bounds: likewise of `simulation.bounds`, which the simulation has to keep.

    Returns:
        The wearer and every garment, frame by frame.

    Raises:
        InputError: an argument is out of range, the body overlaps itself in this motion, or the
            simulation is out of bounds; names what was found and expected.
    """
    worn, model = _garments_of(outfit), wearer(body, gender)
    cloth, chosen = _solver(solver), SimulationSettings(**(settings or {}))
    limits = HealthBounds(**(bounds or {}))
    record = put_on(model, motion, gender, shape, worn, made_for_it=not isinstance(outfit, str))
    if isinstance(outfit, str):
        made = sample_outfit(
            rng_for(seed, "outfit"),
            build_templates(model),
            model,
            gender=gender,
            shape=record.shape,
            outfit_type=outfit,
            edge_length_m=edge_length_m,
        )
        garments = move_outfit(DressedBody(model, record, made), cloth, chosen, limits)
    else:
        garments = simulate_sheets(
            {name: Mesh(mesh.vertices, mesh.triangles) for name, mesh in outfit.items()},
            model,
            record,
            cloth,
            edge_length_m=edge_length_m,
            simulation=chosen,
            bounds=limits,
        )
    return SimulatedOutfit.of(garments, model, record)


def write_outfit(
    folder: str | Path, worn: SimulatedOutfit, colours: Mapping[str, Sequence[float]]
) -> None:
    """Write a CLOTH3D folder as `write_reconstruction` does.

    Args:
        folder: replaced as a whole; its name is the sample's id.
        colours: garment type -> sRGB in 0-1.
    """
    textures = {
        name: {"texture": {"type": "color", "data": list(colours[name])}} for name in worn.garments
    }
    write_reconstruction(
        folder,
        worn.model,
        SampleInfo(worn.poses, worn.trans, worn.shape, worn.gender, outfit=textures),
        [
            GarmentAnimation(name, sheet.rest, np.stack([one.vertices for one in sheet.frames]))
            for name, sheet in worn.garments.items()
        ],
        np.stack([one.vertices for one in worn.body]),
    )


def _garments_of(outfit: str | Mapping[str, Mesh]) -> list[str]:
    """Types of the garments."""
    if isinstance(outfit, str):
        if outfit not in OUTFIT_TYPES:
            raise InputError(f"outfit: '{outfit}', expected one of {', '.join(OUTFIT_TYPES)}")
        return outfit.split("+")
    unknown = [name for name in outfit if name not in GARMENTS]
    if unknown:
        raise InputError(f"outfit: '{unknown[0]}', expected one of {', '.join(GARMENTS)}")
    return list(outfit)


def wearer(body: BodyModel | str | Path | None, gender: str) -> BodyModel:
    """A body as `simulate` takes it.

    Raises:
        InputError: there is no such gender, or the file is missing or damaged.
    """
    if gender not in GENDERS:
        raise InputError(f"gender: '{gender}', expected one of {', '.join(GENDERS)}")
    if isinstance(body, BodyModel):
        return body
    return load_body(free_body(gender) if body is None else body)


def put_on(
    body: BodyModel,
    motion: Motion,
    gender: str,
    shape: Sequence[float] | np.ndarray | None,
    garments: Sequence[str],
    *,
    made_for_it: bool,
) -> BodySequence:
    """A body in motion, free of self-collisions.

    Args:
        shape: (10,); the mean body if None.
        garments: types that it is going to wear.
        made_for_it: whether they fit this shape alone, so that the body cannot be made thinner.

    Raises:
        InputError: the shape is not 10 numbers, or the body overlaps itself in this motion.
    """
    wanted = np.zeros(10) if shape is None else np.asarray(shape, dtype=np.float64)
    if wanted.shape != (10,) or not np.isfinite(wanted).all():
        raise InputError(f"shape: {wanted!r:.100}, expected 10 finite numbers")
    motion = resample(check_motion(motion))
    record = make_body_sequence(
        body,
        wanted,
        motion.poses,
        motion.trans,
        gender=gender,
        reference_leg_length_m=motion.reference_leg_length_m,
        removable=removable_limbs(garments),
    )
    if record.outcome == "rejected":
        raise InputError(f"{motion.sequence}: {record.reason}")
    if made_for_it and record.outcome == "thinned":
        raise InputError(
            "shape: the body overlaps itself in this motion and would be made thinner, but these"
            " garments are made for it; expected another shape or motion"
        )
    return record


def _solver(solver: str | ClothSolver | None) -> ClothSolver:
    if solver is None:
        code = QUICK_SOLVER.code
    elif not isinstance(solver, str):
        return solver
    elif solver in CLOTH_SOLVERS:
        code = CLOTH_SOLVERS[solver].code
    else:
        raise InputError(f"solver: '{solver}', expected one of {', '.join(CLOTH_SOLVERS)}")
    return import_module(code).cloth_solver(1)
