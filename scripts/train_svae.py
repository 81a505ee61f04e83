"""Rule `train_svae`: the paper's VAE of garments in rest pose, in one of its variants."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.learning_data.static import StaticData
from drapeline.models.gcvae.data import static_body_template
from drapeline.models.gcvae.load import save_static_files
from drapeline.models.gcvae.settings import VaeSettings
from drapeline.models.gcvae.train import train_vae
from drapeline.models.gcvae.vae import StaticVae
from drapeline.registration.to_body.hierarchy import load_hierarchy
from drapeline.registration.to_body.topology import load_topology
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params = snakemake.input, snakemake.params
    garments, topology = StaticData(given.data), load_topology(given.topology)
    template = static_body_template(
        garments,
        topology,
        load_hierarchy(given.hierarchy),
        {gender: load_body(given[gender]) for gender in GENDERS},
    )
    model = StaticVae(VaeSettings(**params.settings), template)
    train_vae(
        snakemake.output[0],
        model,
        garments,
        conditioning=given.conditioning,
        code=params.code,
        progress=params.progress,
        trainer=params.trainer,
        threads=snakemake.threads,
        complete=lambda folder: save_static_files(folder, model, garments, topology),
    )
