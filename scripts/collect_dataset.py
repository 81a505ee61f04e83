"""Rule `collect_dataset`: the accepted samples in their splits, tables and the dataset card."""

from typing import TYPE_CHECKING

from drapeline.dataset.collect import collect_dataset
from drapeline.dataset.shards import samples_of
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    records = collect_dataset(samples_of(snakemake.input), snakemake.output.dataset)
    accepted = sum(record.accepted for record in records)
    log.info("%d of %d samples accepted", accepted, len(records))
