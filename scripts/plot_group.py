"""Rule `plot_group`: a sheet of samples of a group."""

from typing import TYPE_CHECKING

from drapeline.dataset.shards import samples_of
from drapeline.rendering.raytracer import ray_share
from drapeline.report.dataset.gallery import plot_group
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log, ray_share(snakemake.params.rays):
    shown = plot_group(snakemake.output[0], samples_of(snakemake.input), most=snakemake.params.most)
    log.info("%d samples", shown)
