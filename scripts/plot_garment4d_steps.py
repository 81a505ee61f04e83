"""Rule `plot_garment4d_steps`: figures 4 and 5."""

from typing import TYPE_CHECKING

from drapeline.metrics.predictions import first_reconstructions, load_reconstruction
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.garment4d.figures import plot_results, plot_steps, spread_frames
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    printed, ours = zip(*first_reconstructions(snakemake.input), strict=True)
    for path, plot, sequences, shown in (
        (snakemake.output.steps, plot_steps, printed, 2),
        (snakemake.output.results, plot_results, ours, 5),
    ):
        cases = map(load_reconstruction, sequences)
        plot(path, [(case, spread_frames(len(case.final), shown)) for case in cases])
