"""Rule `collect_metrics`: one table of the metrics of every model."""

from typing import TYPE_CHECKING

from drapeline.metrics.table import collect_metrics
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    log.info("%d rows", collect_metrics(snakemake.output[0], snakemake.input))
