"""Rule `render_modalities`: pictures, maps, boxes and keypoints of chosen frames."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.blender.render import render_modalities
from drapeline.bodies.model import load_bodies
from drapeline.frames import GENDERS
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    render_modalities(
        Path(snakemake.input.shard, snakemake.wildcards.sample),
        snakemake.output[0],
        snakemake.params.frames,
        bodies=load_bodies({gender: snakemake.input[gender] for gender in GENDERS}),
        cameras=snakemake.params.cameras,
    )
