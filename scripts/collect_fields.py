"""Rule `collect_fields`: fields of a model's garments as mapped arrays, and the body's clusters."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.learning_data.garment_fields import collect_fields
from drapeline.learning_data.occlusion import texture_pixels
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given, params = snakemake.input, snakemake.params
    bodies = {gender: load_body(given[gender]) for gender in GENDERS}
    count = collect_fields(
        snakemake.output[0],
        given.shards,
        params.garments,
        bodies,
        texture_pixels(bodies[GENDERS[0]], params.resolution),
        clusters=params.clusters,
    )
    log.info("%d garments", count)
