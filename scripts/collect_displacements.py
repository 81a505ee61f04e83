"""Rule `collect_displacements`: what poses do to a model's simulated garments, as mapped arrays."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.dataset.shards import samples_of_shards
from drapeline.frames import GENDERS
from drapeline.learning_data.pose_displacements import collect_displacements
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given, params = snakemake.input, snakemake.params
    frames = collect_displacements(
        snakemake.output[0],
        [*given.samples, *samples_of_shards(given.learning)],
        params.garments,
        {gender: load_body(given[gender]) for gender in GENDERS},
        frame_step=params.frame_step,
    )
    log.info("%d frames", frames)
