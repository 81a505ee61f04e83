"""Rule `train_svae`: the VAE of garments in rest pose, in one of its variants."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.learning_data.static import StaticData
from drapeline.models.gcvae.template_statistics import static_body_template
from drapeline.models.gcvae.train import train_vae
from drapeline.models.gcvae.vae import VaeSettings
from drapeline.models.gcvae.variants import SVAE_VARIANTS, laid_over
from drapeline.registration.to_body.hierarchy import load_hierarchy
from drapeline.registration.to_body.topology import load_topology
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    data = StaticData(snakemake.input.data)
    changes = SVAE_VARIANTS[snakemake.wildcards.svae]
    train_vae(
        snakemake.output[0],
        data,
        static_body_template(
            data,
            load_topology(snakemake.input.topology),
            load_hierarchy(snakemake.input.hierarchy),
            {gender: load_body(snakemake.input[gender]) for gender in GENDERS},
        ),
        VaeSettings.of(laid_over(snakemake.params.settings, changes)),
        conditioning=snakemake.input.get("conditioning"),
        code=snakemake.params.code,
        progress=snakemake.params.progress,
        trainer=snakemake.params.trainer,
        threads=snakemake.threads,
    )
