"""Rules of models: a function of the model, by its name."""

from types import SimpleNamespace
from typing import TYPE_CHECKING

from drapeline.job import Job, resolve
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    params = snakemake.params
    resolve(params.run)(
        Job(
            snakemake.input,
            snakemake.output,
            SimpleNamespace(**params.told),
            snakemake.threads,
            params.code,
            params.progress,
        )
    )
