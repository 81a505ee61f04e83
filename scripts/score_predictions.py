"""Rule `score_predictions`: a method from elsewhere, measured by its folder of meshes."""

from types import SimpleNamespace
from typing import TYPE_CHECKING

from drapeline.job import Job
from drapeline.models.protocol import score
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given = snakemake.input
    score(Job(given, snakemake.output, SimpleNamespace(**snakemake.params.told)))
