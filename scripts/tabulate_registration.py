"""Rule `tabulate_registration`: errors of the round trip per garment type, table and page."""

from typing import TYPE_CHECKING

from drapeline.report.registration_table import write_registration_tables
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    write_registration_tables(
        snakemake.output.table,
        snakemake.output.page,
        {group: snakemake.input[group] for group in snakemake.params.groups},
    )
