"""Rule `tabulate_scans`: the page of all models' fits to scans."""

from typing import TYPE_CHECKING

from drapeline.report.models.comparisons import write_scans_page
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    write_scans_page(snakemake.output[0], snakemake.input[0])
