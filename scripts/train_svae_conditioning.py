"""Rule `train_svae_conditioning`: the autoencoder of the conditions of garments in rest pose."""

from typing import TYPE_CHECKING

from drapeline.learning_data.static import StaticData
from drapeline.models.gcvae.settings import ConditioningSettings
from drapeline.models.gcvae.train import train_conditioning
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    train_conditioning(
        snakemake.output[0],
        StaticData(snakemake.input.data),
        ConditioningSettings(**snakemake.params.settings),
        code=snakemake.params.code,
        progress=snakemake.params.progress,
        threads=snakemake.threads,
    )
