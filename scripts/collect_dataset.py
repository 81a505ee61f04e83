"""Rule `collect_dataset`: the accepted samples in their splits, tables and the dataset card."""

import sys
from typing import TYPE_CHECKING

from drapeline.dataset.collect import collect_dataset, outcome
from drapeline.dataset.shards import samples_of
from drapeline.errors import InputError
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    records = collect_dataset(samples_of(snakemake.input), snakemake.output.dataset)
    words = outcome(records)
    log.info("%s", words)
    if not any(record.accepted for record in records):
        raise InputError(f"{words}, expected at least one; pictures show what was wrong")
    sys.stdout.write(f"drapeline: {words}\n")
