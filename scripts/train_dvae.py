"""Rule `train_dvae`: the VAE of garments in motion, in one of its variants."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.models.gcvae.dynamic_garments import dynamic_garments
from drapeline.models.gcvae.template_statistics import dynamic_body_template
from drapeline.models.gcvae.train import train_vae
from drapeline.models.gcvae.vae import VaeSettings
from drapeline.models.gcvae.variants import DVAE_VARIANTS, dynamic_conditions, laid_over
from drapeline.registration.to_body.hierarchy import load_hierarchy
from drapeline.registration.to_body.topology import load_topology
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    variant = snakemake.wildcards.dvae
    _, frames = dynamic_conditions(variant)
    garments = dynamic_garments(snakemake.input.data, snakemake.input.svae, frames)
    train_vae(
        snakemake.output[0],
        garments,
        dynamic_body_template(
            garments,
            load_topology(snakemake.input.topology),
            load_hierarchy(snakemake.input.hierarchy),
            {gender: load_body(snakemake.input[gender]) for gender in GENDERS},
        ),
        VaeSettings.of(laid_over(snakemake.params.settings, DVAE_VARIANTS[variant])),
        conditioning=snakemake.input.get("conditioning"),
        code=snakemake.params.code,
        progress=snakemake.params.progress,
        trainer=snakemake.params.trainer,
        threads=snakemake.threads,
    )
