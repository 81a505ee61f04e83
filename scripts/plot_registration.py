"""Rule `plot_registration`: one registered garment of each type, with its errors."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.outfits.static import load_static
from drapeline.registration.to_body.topology import load_topology
from drapeline.rendering.raytracer import ray_share
from drapeline.report.registration_sheets import plot_registration
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    plot_registration(
        snakemake.output[0],
        load_topology(snakemake.input.topology),
        {gender: load_body(snakemake.input[gender]) for gender in GENDERS},
        (outfit for path in snakemake.input.outfits for outfit in load_static(path)),
        snakemake.params.garments,
    )
