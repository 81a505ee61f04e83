"""Rule `tabulate_smplicit`: how well SMPLicit holds held-out garments."""

from typing import TYPE_CHECKING

from drapeline.report.models.smplicit.tables import write_smplicit_page
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    write_smplicit_page(snakemake.output[0], snakemake.input[0])
