"""Rule `plot_fitted_picture`: a user's picture with the garments that were found in it."""

from typing import TYPE_CHECKING

from drapeline.metrics.predictions import load_fitted_picture
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.smplicit.figures import plot_own_picture
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    plot_own_picture(snakemake.output[0], load_fitted_picture(snakemake.input[0]))
