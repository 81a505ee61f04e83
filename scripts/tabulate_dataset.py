"""Rule `tabulate_dataset`: tables 1 and 2 of the CLOTH3D paper for our data."""

from typing import TYPE_CHECKING

from drapeline.report.dataset.statistics import write_paper_tables
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    write_paper_tables(snakemake.output[0], snakemake.input.dataset)
