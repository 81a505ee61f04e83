"""Somebody dressed in a clip of one's own: a sample without an experiment around it."""

import logging
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from drapeline.bodies.model import BodyModel
from drapeline.bodies.sequence import save_body_sequence
from drapeline.dataset.writer import write_sample
from drapeline.experiment.cloth_solvers import QUICK_SOLVER
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.generation.body import animate
from drapeline.generation.outfit import Wearer, dress
from drapeline.generation.settings import BodySettings, OutfitSettings
from drapeline.motions.motion import Motion
from drapeline.outfits.settings import OwnGarment
from drapeline.outfits.templates import build_templates
from drapeline.seeding import rng_for
from drapeline.simulation.settings import HealthBounds, SimulationSettings
from drapeline.simulation.simulate import DressedBody, simulate_outfit

LOGGER = logging.getLogger("drapeline")


def dress_clip(
    folder: str | Path,
    motion: Motion,
    body: BodyModel,
    *,
    gender: str,
    outfit_type: str,
    own: Mapping[str, OwnGarment] | None = None,
    fabric: str | None = None,
    bodies: BodySettings | None = None,
    outfits: OutfitSettings | None = None,
    simulation: SimulationSettings | None = None,
    bounds: HealthBounds | None = None,
    seed: int = 0,
) -> dict[str, Any]:
    """Write a sample of one person in one outfit, as the rules of the workflow make them.

    Args:
        folder: of the sample, in CLOTH3D's format; its name is the sample's id.
        motion: at 30 frames per second.
        body: of this gender.
        outfit_type: one of `OUTFIT_TYPES`.
        own: garment type -> one's own garment in its place.
        fabric: of all garments; None draws one for each.
        bodies, outfits, simulation, bounds: settings; None takes the defaults.
        seed: of the body's shape and of the outfit.

    Returns:
        The sample's `meta.json`; its "status" is "accepted", or else its "reason" tells why not.

    Raises:
        InputError: a garment cannot be worn.
    """
    sample = Path(folder).name
    bodies, outfits = bodies or BodySettings(), outfits or OutfitSettings()
    if fabric:
        outfits = outfits.replace(fabrics=(fabric,))
    plan = SamplePlan(
        sample, gender, outfit_type, "train", motion.sequence or "clip", stop=len(motion)
    )
    record = animate(plan, motion, body, bodies, seed)
    LOGGER.info("body: %s in %d frames, %s", gender, len(record.poses), record.outcome)
    outfit = dress(plan, record, Wearer(body, build_templates(body), own or {}), outfits, seed)
    for garment in outfit.garments:
        LOGGER.info(
            "outfit: %s of %s, %d vertices",
            *(garment.name, garment.attributes["fabric"], len(garment.vertices)),
        )
    with TemporaryDirectory(prefix="drapeline-") as name:
        scratch = Path(name)
        save_body_sequence(scratch / "body.npz", record)
        outfit.save(scratch / "outfit.npz", scratch / "outfit.json", split=plan.split)
        status = simulate_outfit(
            scratch / "simulated",
            DressedBody(body, record, outfit),
            import_module(QUICK_SOLVER.code).cloth_solver(1),
            settings=simulation or SimulationSettings(),
            bounds=bounds or HealthBounds(),
        )
        return write_sample(
            rng_for(seed, "scene", sample),
            folder,
            body=body,
            body_record=scratch / "body.npz",
            outfit=scratch / "outfit.npz",
            simulation=scratch / "simulated",
            status=status,
            seed=seed,
            split=plan.split,
        )
