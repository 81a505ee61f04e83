"""Rule `make_static_outfits`: a shard of outfits in rest pose, each on a body of its own."""

from importlib import import_module
from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.generate_static import make_static
from drapeline.outfits.static import save_static
from drapeline.outfits.static_plan import StaticPlan
from drapeline.outfits.templates import load_templates
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    wanted = snakemake.params
    bodies = {gender: load_body(snakemake.input[f"{gender}_body"]) for gender in GENDERS}
    outfits = make_static(
        [StaticPlan(**plan) for plan in wanted.plans],
        {gender: load_templates(snakemake.input[f"{gender}_templates"]) for gender in GENDERS},
        bodies,
        seed=wanted.seed,
        shape_range=wanted.shape_range,
        edge_length_m=wanted.edge_length_m,
        ranges=OutfitRanges(
            tightness=tuple(wanted.tightness_range), elastic_chance=wanted.elastic_probability
        ),
    )
    if wanted.settling:
        # Imported here, since without it no code of simulations counts in the digest of the rule.
        settling, solver = (import_module(name) for name in wanted.settling["modules"])
        outfits = settling.settle_static(
            outfits,
            bodies,
            solver.cloth_solver(snakemake.threads, wanted.settling["accelerator"]),
            frames=wanted.settling["frames"],
            settings=wanted.settling["settings"],
            bounds=wanted.settling["bounds"],
        )
    save_static(snakemake.output.arrays, outfits)
    log.info("%d garments", sum(len(outfit.garments) for _, _, outfit in outfits))
