"""Rule `plot_time`: time and memory of each step."""

from typing import TYPE_CHECKING

from drapeline.report.times import job_times, write_times
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    params, made = snakemake.params, snakemake.output
    jobs = job_times(params.folders, params.stages)
    write_times(jobs, figure=made.figure, table=made.table, page=made.page)
    log.info("%d jobs, %.1f s", len(jobs), jobs["s"].sum())
