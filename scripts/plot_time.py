"""Rule `plot_time`: time and memory of each step."""

from typing import TYPE_CHECKING

from drapeline.report.times import step_times, write_times
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    steps = step_times(snakemake.params.folders)
    write_times(
        steps,
        figure=snakemake.output.figure,
        table=snakemake.output.table,
        page=snakemake.output.page,
    )
    for step in steps:
        log.info("%s: %d jobs, %.1f s", step.rule, len(step.seconds), step.total_s)
