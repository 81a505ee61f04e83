"""Rule `plot_garment4d_steps`: figures 4 and 5."""

from typing import TYPE_CHECKING

from drapeline.metrics.reconstructions import first_reconstructions, load_reconstruction
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.garment4d_figures import plot_results, plot_steps, spread
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

_STEPS, _RESULTS = 2, 5

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    steps, results = (
        [load_reconstruction(path) for path in paths]
        for paths in zip(*first_reconstructions(snakemake.input), strict=True)
    )
    plot_steps(snakemake.output.steps, [(c, spread(len(c.final), _STEPS)) for c in steps])
    plot_results(snakemake.output.results, [(c, spread(len(c.final), _RESULTS)) for c in results])
