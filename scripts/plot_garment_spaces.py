"""Rule `plot_garment_spaces`: the principal components of canonical garments."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.registration.to_template.garment_space import load_space
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.garment4d.figures import plot_explained, plot_modes
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    spaces = {
        garment: load_space(Path(folder) / "space.npz")
        for garment, folder in snakemake.input.items()
    }
    plot_explained(snakemake.output.explained, spaces)
    plot_modes(snakemake.output.modes, spaces)
