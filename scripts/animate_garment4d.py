"""Rule `animate_garment4d`: a reconstruction in motion."""

from dataclasses import replace
from typing import TYPE_CHECKING

from drapeline.metrics.predictions import first_reconstructions, load_reconstruction
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.garment4d.figures import animate_steps
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

_FRAMES = 24
_PER_FRAME = (
    *("proposal", "final", "true", "points", "labels", "body"),
    *("root_rotation", "root_height", "number"),
)

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    _, ours = first_reconstructions(snakemake.input)[0]
    shown = load_reconstruction(ours)
    animate_steps(
        snakemake.output[0],
        replace(shown, **{name: getattr(shown, name)[:_FRAMES] for name in _PER_FRAME}),
    )
