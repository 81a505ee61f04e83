"""Rule `plot_statistics`: figures of what the dataset holds."""

from typing import TYPE_CHECKING

from drapeline.dataset.collect import accepted_records
from drapeline.report.dataset.statistics import (
    plot_actions,
    plot_bodies,
    plot_garments,
    plot_splits,
    plot_vertices,
)
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    dataset = snakemake.input.dataset
    records = accepted_records(dataset)
    plot_garments(snakemake.output.garments, dataset)
    plot_actions(snakemake.output.actions, dataset)
    plot_splits(snakemake.output.splits, dataset)
    plot_bodies(snakemake.output.bodies, records)
    plot_vertices(snakemake.output.vertices, records)
    log.info("%d samples", len(records))
