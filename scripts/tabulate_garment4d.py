"""Rule `tabulate_garment4d`: tables 2 to 4, and our numbers beside the paper's."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.registration.error_table import FILE_NAME
from drapeline.report.models.garment4d.tables import (
    write_garment4d_beside_paper,
    write_garment4d_page,
)
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given = snakemake.input
    write_garment4d_page(
        snakemake.output.page,
        given.metrics,
        [Path(fits) / FILE_NAME for fits in given.fits],
        snakemake.params.departures,
    )
    write_garment4d_beside_paper(snakemake.output.table, given.metrics)
