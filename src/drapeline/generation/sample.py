"""A sample, from its plan to its CLOTH3D folder."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from drapeline.bodies.sequence import save_body_sequence
from drapeline.dataset.writer import write_sample
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.generation.body import animate
from drapeline.generation.outfit import Wearer, dress
from drapeline.generation.settings import BodySettings, OutfitSettings
from drapeline.motions.motion import Motion
from drapeline.seeding import rng_for
from drapeline.simulation.settings import HealthBounds, SimulationSettings
from drapeline.simulation.simulate import DressedBody, simulate_outfit
from drapeline.simulation.solver import ClothSolver


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
