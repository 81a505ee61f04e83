"""Rules `export_sample`, `export_animated` and others: garments in motion for other programs."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.blender.export import export_sample
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    wanted = snakemake.wildcards
    sample = Path(snakemake.input[0], getattr(wanted, "sample", ""))
    names = export_sample(sample, snakemake.output[0], wanted.format)
    log.info("wrote %s", ", ".join(names))
