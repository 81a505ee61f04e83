"""Rule `render_modalities`: colour, depth, normals, velocities and segments of chosen frames."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.blender.render import render_modalities
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    sample = Path(snakemake.input[0], snakemake.wildcards.sample)
    render_modalities(sample, snakemake.output[0], snakemake.params.frames)
