"""Rule `collect_metrics`: one table of the metrics of every evaluation that belongs to it."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.metrics.table import METRICS_FILE, collect_metrics
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    tables = [Path(folder) / METRICS_FILE for folder in snakemake.input]
    log.info("%d rows", collect_metrics(snakemake.output[0], tables))
