"""Rule `plot_fit_images`: garments found in pictures of held-out samples, beside the true ones."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.metrics.predictions import load_fitted_picture
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.garment4d.figures import spread_frames
from drapeline.report.models.smplicit.figures import plot_known_pictures
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    files = sorted(Path(snakemake.input[0]).glob("*.npz"))
    shown = [files[k] for k in spread_frames(len(files), snakemake.params.most)]
    plot_known_pictures(snakemake.output[0], [load_fitted_picture(file) for file in shown])
