"""Rule `plot_own_scans`: a user's scans, with the bodies and garments found in them."""

from typing import TYPE_CHECKING

from drapeline.dataset.segmented_scans import load_scans
from drapeline.metrics.predictions import load_fitted_scans
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.scans import plot_own_scans
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    given = snakemake.input
    scans, fits = [scan for scan, _ in load_scans(given.scans)], load_fitted_scans(given.shown)
    shown = [(scan, fits[scan.name]) for scan in scans[: snakemake.params.most]]
    plot_own_scans(snakemake.output[0], shown)
