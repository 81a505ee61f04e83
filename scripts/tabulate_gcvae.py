"""Rule `tabulate_gcvae`: tables 3 and 4 of the CLOTH3D paper for our garment VAEs."""

from typing import TYPE_CHECKING

from drapeline.report.models.gcvae.tables import write_gcvae_beside_paper, write_gcvae_page
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    write_gcvae_page(snakemake.output.page, snakemake.input[0])
    write_gcvae_beside_paper(snakemake.output.table, snakemake.input[0])
