"""Rule `train_svae_ours`: our own VAE of garments in rest pose."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.learning_data.static import StaticData
from drapeline.models.gcvae.ppca_vae import StaticPpcaVae
from drapeline.models.gcvae.settings import VaeSettings
from drapeline.models.gcvae.static_template import static_body_template
from drapeline.models.gcvae.train import train_vae
from drapeline.models.gcvae.variants import OUR_VARIANTS
from drapeline.models.training.settings import override_settings
from drapeline.registration.to_body.hierarchy import load_hierarchy
from drapeline.registration.to_body.topology import load_topology
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params = snakemake.input, snakemake.params
    variant = "svae_ours"
    garments = StaticData(given.data)
    template = static_body_template(
        garments,
        load_topology(given.topology),
        load_hierarchy(given.hierarchy),
        {gender: load_body(given[gender]) for gender in GENDERS},
    )
    settings = VaeSettings.of(override_settings(params.settings, OUR_VARIANTS[variant]))
    train_vae(
        snakemake.output[0],
        StaticPpcaVae(settings, template),
        garments,
        conditioning=None,
        code=params.code,
        progress=params.progress,
        trainer=params.trainer,
        threads=snakemake.threads,
    )
