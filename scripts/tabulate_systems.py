"""Rule `tabulate_systems`: the page of all systems on the same samples."""

from typing import TYPE_CHECKING

from drapeline.report.models.systems import write_systems_page
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    write_systems_page(snakemake.output[0], snakemake.input)
