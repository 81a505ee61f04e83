"""Rule `render_gallery`: a still and a moving picture of one sample."""

from typing import TYPE_CHECKING

from drapeline.rendering.raytracer import ray_share
from drapeline.report.dataset.gallery import render_gallery
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    render_gallery(snakemake.input[0], snakemake.output.still, snakemake.output.moving)
