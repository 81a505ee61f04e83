"""Rule `plot_garment_spaces`: the principal components of canonical garments."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.registration.garment_space import load_space
from drapeline.report.garment4d_figures import plot_explained, plot_modes
from drapeline.report.studio import ray_share
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
