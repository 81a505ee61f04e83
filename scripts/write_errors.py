"""Rule `write_errors`: errors of the models beside baselines, for the front page of the report."""

from typing import TYPE_CHECKING

from drapeline.report.overview import write_errors
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given = snakemake.input
    write_errors(snakemake.output[0], given.registration, given.metrics)
