"""The steps that make a sample, each from its plan and a random stream of its own."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from drapeline.bodies.animation import first_free_sequence
from drapeline.bodies.model import BodyModel
from drapeline.bodies.sampling import sample_shape
from drapeline.bodies.sequence import BodySequence, ClipLabels, save_body_sequence
from drapeline.dataset.writer import write_sample
from drapeline.experiment.samples import SamplePlan
from drapeline.frames import GENDERS
from drapeline.motions.motion import Motion
from drapeline.motions.variation import cut_piece
from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.generate import sample_outfit
from drapeline.outfits.outfit import Outfit
from drapeline.outfits.own_garments import OwnGarment
from drapeline.outfits.templates import Templates
from drapeline.seeding import rng_for
from drapeline.simulation.attempts import SimulationSettings
from drapeline.simulation.health import HealthBounds
from drapeline.simulation.simulate import DressedBody, simulate_outfit
from drapeline.simulation.solver import ClothSolver


@dataclass(frozen=True)
class BodySettings:
    """How bodies are drawn and freed of self-collisions.

    Attributes:
        shape_range: shape coefficients lie within plus or minus this.
        shape_draws: shapes to try before a sample is rejected.
        segment_gap_m: between parts that were pressed apart.
    """

    shape_range: float
    shape_draws: int
    segment_gap_m: float


@dataclass(frozen=True)
class OutfitSettings:
    """How outfits are made; see `sample_outfit`.

    Attributes:
        edge_length_m: mean length of edges.
        vertices_min: of a garment; its edges are shortened until it has so many.
        tightness_range: lower and upper end.
        elastic_probability: that an end is gathered.
    """

    edge_length_m: float
    vertices_min: int
    tightness_range: tuple[float, float]
    elastic_probability: float


@dataclass(frozen=True)
class Wearer:
    """What samples of one gender are made from.

    Attributes:
        body: the body model.
        templates: panels that garments are cut from.
        own: garment type -> the user's garment in its place.
    """

    body: BodyModel
    templates: Templates
    own: Mapping[str, OwnGarment]


def animate(
    plan: SamplePlan, motion: Motion, body: BodyModel, settings: BodySettings, seed: int
) -> BodySequence:
    """A random body of the planned gender in the planned piece of a clip, free of self-collisions.

    Args:
        plan: of the sample.
        motion: the clip, at 30 fps.
        body: of the plan's gender.
        settings: see there.
        seed: the experiment's.
    """
    piece = cut_piece(motion, plan.start, plan.stop, speed=plan.speed, mirrored=plan.mirrored)
    shapes = rng_for(seed, "shape", plan.sample)
    return first_free_sequence(
        body,
        (sample_shape(shapes, settings.shape_range) for _ in range(settings.shape_draws)),
        piece.poses,
        piece.trans,
        gender=GENDERS.index(plan.gender),
        reference_leg_length_m=motion.reference_leg_length_m,
        removable=plan.removable,
        shape_range=settings.shape_range,
        gap_m=settings.segment_gap_m,
        labels=ClipLabels(
            plan.sub_sequence,
            motion.action,
            motion.subject,
            motion.source,
            plan.start,
            plan.speed,
            plan.mirrored,
        ),
    )


def dress(
    plan: SamplePlan, motion: BodySequence, wearer: Wearer, settings: OutfitSettings, seed: int
) -> Outfit:
    """A unique outfit of the planned type, for the body that moves.

    Args:
        plan: of the sample.
        motion: the wearer's shape is taken.
        wearer: of the plan's gender.
        settings: see there.
        seed: the experiment's.
    """
    return sample_outfit(
        rng_for(seed, "outfit", plan.sample),
        wearer.templates,
        wearer.body,
        gender=plan.gender,
        shape=motion.shape,
        outfit_type=plan.outfit_type,
        edge_length_m=settings.edge_length_m,
        vertices_min=settings.vertices_min,
        ranges=OutfitRanges(
            tightness=tuple(settings.tightness_range), elastic_chance=settings.elastic_probability
        ),
        own=wearer.own,
    )


def make_sample(
    folder: str | Path,
    plan: SamplePlan,
    clip: Motion,
    wearer: Wearer,
    solver: ClothSolver,
    *,
    bodies: BodySettings,
    outfits: OutfitSettings,
    simulation: SimulationSettings,
    bounds: HealthBounds,
    seed: int,
) -> dict[str, Any]:
    """Make a sample from its plan to its CLOTH3D folder.

    Args:
        folder: replaced as a whole; its name is the plan's id.
        plan: of the sample.
        clip: that its motion is a piece of.
        wearer: of the plan's gender.
        solver: simulates it.
        bodies, outfits, simulation, bounds: see there.
        seed: the experiment's.

    Returns:
        The contents of `meta.json`.
    """
    with TemporaryDirectory(dir=Path(folder).parent, prefix=".making-") as name:
        scratch = Path(name)
        motion = animate(plan, clip, wearer.body, bodies, seed)
        save_body_sequence(scratch / "body.npz", motion)
        outfit = dress(plan, motion, wearer, outfits, seed)
        outfit.save(scratch / "outfit.npz", scratch / "outfit.json")
        simulate_outfit(
            scratch / "simulation",
            DressedBody(wearer.body, motion, outfit),
            solver,
            settings=simulation,
            bounds=bounds,
        )
        return write_sample(
            rng_for(seed, "scene", plan.sample),
            folder,
            body=wearer.body,
            body_record=scratch / "body.npz",
            outfit=scratch / "outfit.npz",
            simulation=scratch / "simulation",
            seed=seed,
            split=plan.split,
        )
