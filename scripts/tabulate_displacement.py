"""Rule `tabulate_displacement`: how well SMPLicit's garments follow poses."""

from typing import TYPE_CHECKING

from drapeline.report.models.smplicit.displacement_tables import write_displacement_page
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    write_displacement_page(snakemake.output[0], snakemake.input)
