"""Rule `collect_dynamic`: frames of registered garments in motion, as arrays that are mapped."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.dataset.shards import samples_of
from drapeline.frames import GENDERS
from drapeline.learning_data.dynamic import collect_dynamic
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given = snakemake.input
    frames = collect_dynamic(
        snakemake.output[0],
        dict(zip(samples_of(given.samples), samples_of(given.registrations), strict=True)),
        {gender: load_body(given[gender]) for gender in GENDERS},
        version=snakemake.wildcards.version,
        step=snakemake.params.frame_step,
    )
    log.info("%d frames", frames)
