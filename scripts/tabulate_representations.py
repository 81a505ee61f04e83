"""Rule `tabulate_representations`: the page of the shared comparison."""

from typing import TYPE_CHECKING

from drapeline.report.models.comparisons import write_representations
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    write_representations(snakemake.output[0], snakemake.input[0])
