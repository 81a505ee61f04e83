"""Rule `plot_gcvae_samples`: a sheet of sampled garments on their wearers."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.models.gcvae.sample import load_samples, wearer_mesh
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.gcvae.figures import plot_samples, walk_view
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    bodies = {gender: load_body(snakemake.input[gender]) for gender in GENDERS}
    views = {}
    samples = load_samples(snakemake.input.samples)[: snakemake.params.shown]
    mixed = len({sample.asked for sample in samples}) > 1
    for sample in samples:
        caption = f"{sample.name} {sample.garment}" + " (asked)" * (mixed and sample.asked)
        views[caption] = walk_view(sample.mesh, wearer_mesh(bodies, sample.cvar), sample.garment)
    plot_samples(snakemake.output[0], views)
