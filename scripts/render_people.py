"""Rule `render_people`: samples side by side in motion."""

from typing import TYPE_CHECKING

from drapeline.dataset.shards import samples_named
from drapeline.rendering.raytracer import ray_share
from drapeline.report.dataset.people import render_people
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    render_people(snakemake.output[0], samples_named(snakemake.input, snakemake.params.samples))
