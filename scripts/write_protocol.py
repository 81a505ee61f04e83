"""Rule `write_protocol`: the questions that all models are asked, as files."""

from types import SimpleNamespace
from typing import TYPE_CHECKING

from drapeline.job import Job
from drapeline.models.protocol import write_protocol
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given = snakemake.input
    write_protocol(Job(given, snakemake.output, SimpleNamespace(**snakemake.params.told)))
