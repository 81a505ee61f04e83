"""Rule `make_outfits`: unique outfits, cut, resized and sewn each for one body."""

from importlib import import_module
from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.bodies.sequence import load_body_sequence
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.frames import GENDERS
from drapeline.generation.outfit import Wearer, dress, dress_at_rest
from drapeline.generation.settings import BodySettings, OutfitSettings
from drapeline.outfits.settings import OwnGarment
from drapeline.outfits.templates import load_templates
from drapeline.rule_log import progress, rule_log
from drapeline.storage import atomic_folder

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given, params = snakemake.input, snakemake.params
    wearers = {
        gender: Wearer(
            load_body(given[f"{gender}_body"]),
            load_templates(given[f"{gender}_templates"]),
            {name: OwnGarment(**own) for name, own in params.own_garments[gender].items()},
        )
        for gender in GENDERS
    }
    hanger = None
    if params.hanging:
        # Imported here, since without it no code of simulations counts in the digest of the rule.
        hanging, solver = (import_module(name) for name in params.hanging["modules"])
        hanger = hanging.Hanger(
            solver.cloth_solver(snakemake.threads, params.hanging["accelerator"]),
            **params.hanging["how"],
        )
    plans, settings, bodies = (
        [SamplePlan(**plan) for plan in params.plans],
        OutfitSettings(**params.settings),
        BodySettings(**params.bodies),
    )
    with atomic_folder(snakemake.output[0]) as folder:
        for plan in progress(plans, total=len(plans), label="outfits"):
            wearer, name = wearers[plan.gender], folder / plan.sample
            if plan.sequence:
                motion = load_body_sequence(f"{given.bodies}/{plan.sample}.npz")
                outfit = dress(plan, motion, wearer, settings, params.seed)
            else:
                outfit = dress_at_rest(plan, bodies, wearer, settings, params.seed)
            if hanger:
                outfit, reason = hanger.hang(outfit, wearer.body)
                if reason:
                    log.warning("%s stays as it was made: %s", plan.sample, reason)
            outfit.save(f"{name}.npz", f"{name}.json", split=plan.split)
            for garment in outfit.garments:
                log.info("%s: %s, %d vertices", plan.sample, garment.name, len(garment.vertices))
