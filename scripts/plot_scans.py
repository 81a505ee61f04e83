"""Rule `plot_scans`: scans of held-out samples, with the garments that models find in them."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.metrics.predictions import FITTED
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.scans import plot_scans
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    given = snakemake.input
    fits = [Path(folder) / FITTED for folder in given.evaluated]
    plot_scans(snakemake.output[0], given.scans, fits, snakemake.params.most)
