"""Rule `view_example`: the first accepted test sample, or else any, as a page to turn and play."""

from typing import TYPE_CHECKING

from drapeline.report.dataset.viewer import REPORT_BYTES_MAX, example_sample, write_viewer
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    sample = example_sample(snakemake.input.dataset)
    size = write_viewer(snakemake.output[0], sample, bytes_max=REPORT_BYTES_MAX)
    log.info("%s: %.2f MB", sample or "no accepted sample", size / 1e6)
