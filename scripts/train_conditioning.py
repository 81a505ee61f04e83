"""Rule `train_conditioning`: the autoencoder of the conditions of garments at rest or in motion."""

from typing import TYPE_CHECKING

from drapeline.learning_data.static import StaticData
from drapeline.models.gcvae.dynamic_garments import load_dynamic_garments
from drapeline.models.gcvae.train_conditioning import ConditioningSettings, train_conditioning
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    data, frames = snakemake.input.data, snakemake.params.frames
    train_conditioning(
        snakemake.output[0],
        load_dynamic_garments(data, snakemake.input.svae, frames) if frames else StaticData(data),
        ConditioningSettings.of(snakemake.params.settings),
        code=snakemake.params.code,
        progress=snakemake.params.progress,
        threads=snakemake.threads,
    )
