"""Rule `plot_reconstructed`: a garment from a user's scans, step by step and in motion."""

from typing import TYPE_CHECKING

from drapeline.frames import FPS
from drapeline.metrics.predictions import load_reconstruction
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.garment4d.figures import animate_steps, plot_steps, write_page
from drapeline.report.models.scene import spread_frames
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

_STEPS = 3

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    shown = load_reconstruction(snakemake.input[0])
    plot_steps(snakemake.output.steps, [(shown, spread_frames(len(shown.final), _STEPS))])
    write_page(snakemake.output.page, shown)
    frames_apart = int(shown.number[1] - shown.number[0]) if len(shown.number) > 1 else 1
    animate_steps(snakemake.output.moving, shown, frame_ms=1000 * frames_apart / FPS)
