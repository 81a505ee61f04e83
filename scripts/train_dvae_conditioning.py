"""Rule `train_dvae_conditioning`: the autoencoder of the conditions of garments in motion."""

from typing import TYPE_CHECKING

from drapeline.models.gcvae.load import load_dynamic_garments
from drapeline.models.gcvae.settings import ConditioningSettings
from drapeline.models.gcvae.train import train_conditioning
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given = snakemake.input
    train_conditioning(
        snakemake.output[0],
        load_dynamic_garments(given.data, given.static, int(snakemake.wildcards.frames)),
        ConditioningSettings(**snakemake.params.settings),
        code=snakemake.params.code,
        progress=snakemake.params.progress,
        threads=snakemake.threads,
    )
