"""Rule `plot_gcvae_walks`: figure 9, transitions of static garments, one of them in motion."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.learning_data.static import StaticData
from drapeline.models.gcvae.codec import load_codes
from drapeline.models.gcvae.figures import interpolate_as_figure_9
from drapeline.models.gcvae.load import load_codec
from drapeline.models.gcvae.sample import load_types, wearer_mesh
from drapeline.models.training.module import BEST
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.gcvae.figures import animate_views, walk_view
from drapeline.report.models.scene import plot_views
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    model = load_codec(Path(snakemake.input.model) / BEST)
    codes, _ = load_codes(snakemake.input.codes)
    bodies = {gender: load_body(snakemake.input[gender]) for gender in GENDERS}
    data = StaticData(snakemake.input.data)
    types = load_types(snakemake.input.model)
    # Held-out garments where there is one of a type.
    rows = np.concatenate([data.rows(split) for split in ("test", "val", "train")])

    def views(steps):
        return [
            walk_view(step.mesh, wearer_mesh(bodies, step.cvar), step.garment) for step in steps
        ]

    ways = interpolate_as_figure_9(model, types, data, rows, codes.of(rows), snakemake.params.steps)
    plot_views(snakemake.output.sheet, {name: views(steps) for name, steps in ways.items()})
    ways = interpolate_as_figure_9(
        model, types, data, rows, codes.of(rows), snakemake.params.frames
    )
    moving = next(ways[name] for name in ("topology", "cloth", "shape", *ways) if name in ways)
    animate_views(snakemake.output.moving, views(moving))
