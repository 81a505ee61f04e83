"""Rules `export_sample` and `export_reconstructed`: garments in motion for other programs."""

from typing import TYPE_CHECKING

from drapeline.blender.export import export_sample
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    names = export_sample(snakemake.input[0], snakemake.output[0], snakemake.wildcards.format)
    log.info("wrote %s", ", ".join(names))
