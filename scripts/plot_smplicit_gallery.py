"""Rule `plot_smplicit_gallery`: the sheets of a model's gallery."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.models.smplicit.gallery.files import load_gallery
from drapeline.models.smplicit.gallery.plan import SHEETS
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.smplicit.figures import plot_gallery
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    bodies = {gender: load_body(snakemake.input[gender]) for gender in GENDERS}
    garments = load_gallery(snakemake.input.gallery, bodies)
    for sheet in SHEETS:
        plot_gallery(snakemake.output[sheet], [g for g in garments if g.sheet == sheet])
