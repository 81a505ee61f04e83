"""Rule `collect_dynamic`: frames of registered garments in motion, as arrays that are mapped."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.learning_data.dynamic import collect_dynamic
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    frames = collect_dynamic(
        snakemake.output[0],
        dict(zip(snakemake.input.samples, snakemake.input.registrations, strict=True)),
        {gender: load_body(snakemake.input[gender]) for gender in GENDERS},
        version=snakemake.wildcards.version,
        step=snakemake.params.frame_step,
    )
    log.info("%d frames", frames)
