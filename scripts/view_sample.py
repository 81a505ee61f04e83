"""Rule `view_sample`: one sample as a page to turn and play."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.report.dataset.viewer import write_viewer
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    sample = Path(snakemake.input[0], snakemake.wildcards.sample)
    size = write_viewer(snakemake.output[0], sample)
    log.info("%.2f MB", size / 1e6)
