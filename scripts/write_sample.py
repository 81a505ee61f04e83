"""Rule `write_sample`: one simulated sample as a CLOTH3D folder."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.dataset.writer import write_sample
from drapeline.rule_log import rule_log
from drapeline.seeding import rng_for

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    meta = write_sample(
        rng_for(snakemake.params.seed, "scene", snakemake.wildcards.sample),
        snakemake.output[0],
        body=load_body(snakemake.input.body),
        body_record=snakemake.input.animation,
        outfit=snakemake.input.outfit,
        simulation=snakemake.input.simulation,
        seed=snakemake.params.seed,
        split=snakemake.params.split,
    )
    log.info("%s: %s", meta["id"], meta["status"])
