"""Rule `tabulate_smplicit_gallery`: what the codes of all models say about properties."""

from typing import TYPE_CHECKING

from drapeline.report.models.smplicit.tables import (
    read_gallery_tables,
    write_correlations,
    write_gallery_page,
)
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    galleries = {
        model: read_gallery_tables(folder)
        for model, folder in zip(snakemake.params.models, snakemake.input, strict=True)
    }
    write_gallery_page(snakemake.output.page, galleries)
    write_correlations(snakemake.output.table, galleries)
