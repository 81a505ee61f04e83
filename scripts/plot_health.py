"""Rule `plot_health`: figures and the table of the samples' health."""

from typing import TYPE_CHECKING

from drapeline.dataset.collect import accepted_records
from drapeline.report.dataset.health import MEASURES, plot_measure, plot_speed, write_health_page
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    records = accepted_records(snakemake.input.dataset)
    for name, measure in MEASURES.items():
        plot_measure(snakemake.output[name], records, measure)
    plot_speed(snakemake.output.speed, records)
    write_health_page(snakemake.output.page, snakemake.input.dataset, records)
    log.info("%d accepted samples", len(records))
