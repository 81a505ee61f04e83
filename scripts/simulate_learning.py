"""Rule `simulate_learning`: samples of the learning group, from their plans to their folders."""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.frames import GENDERS
from drapeline.generation.outfit import Wearer
from drapeline.generation.sample import make_sample
from drapeline.generation.settings import BodySettings, OutfitSettings
from drapeline.motions.motion import load_motion
from drapeline.outfits.settings import OwnGarment
from drapeline.outfits.templates import load_templates
from drapeline.rule_log import rule_log
from drapeline.simulation.settings import HealthBounds, SimulationSettings
from drapeline.storage import atomic_folder

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given, params = snakemake.input, snakemake.params
    module = import_module(params.solver)
    solver = module.cloth_solver(snakemake.threads, params.accelerator)
    wearers = {
        gender: Wearer(
            load_body(given[f"{gender}_body"]),
            load_templates(given[f"{gender}_templates"]),
            {name: OwnGarment(**own) for name, own in params.own_garments[gender].items()},
        )
        for gender in GENDERS
    }
    plans = [SamplePlan(**planned) for planned in params.plans]
    clips = {
        name: load_motion(Path(given.motions) / f"{name}.npz")
        for name in {plan.sequence for plan in plans}
    }
    with atomic_folder(snakemake.output[0]) as folder:
        for plan in plans:
            meta = make_sample(
                folder / plan.sample,
                plan,
                clips[plan.sequence],
                wearers[plan.gender],
                solver,
                bodies=BodySettings(**params.bodies),
                outfits=OutfitSettings(**params.outfits),
                simulation=SimulationSettings(**params.settings),
                bounds=HealthBounds(**params.bounds),
                seed=params.seed,
            )
            log.info("%s: %s %s", plan.sample, meta["status"], meta["reason"])
