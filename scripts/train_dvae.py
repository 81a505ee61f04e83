"""Rule `train_dvae`: the paper's VAE of garments in motion, in one of its variants."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.models.gcvae.data import dynamic_body_template
from drapeline.models.gcvae.load import load_dynamic_garments
from drapeline.models.gcvae.settings import DvaeSettings
from drapeline.models.gcvae.train import train_vae
from drapeline.models.gcvae.vae import DynamicVae
from drapeline.registration.to_body.hierarchy import load_hierarchy
from drapeline.registration.to_body.topology import load_topology
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params = snakemake.input, snakemake.params
    garments = load_dynamic_garments(given.data, given.static, params.frames)
    template = dynamic_body_template(
        garments,
        load_topology(given.topology),
        load_hierarchy(given.hierarchy),
        {gender: load_body(given[gender]) for gender in GENDERS},
    )
    settings = DvaeSettings(**params.settings)
    train_vae(
        snakemake.output[0],
        DynamicVae(settings, template),
        garments,
        conditioning=given.conditioning,
        code=params.code,
        progress=params.progress,
        trainer=params.trainer,
        threads=snakemake.threads,
    )
