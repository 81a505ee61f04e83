"""Rule `release_dataset`: the dataset as it is published."""

from typing import TYPE_CHECKING

from drapeline.dataset.release import release_dataset
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    release_dataset(snakemake.input[0], snakemake.output[0], **snakemake.params.about)
