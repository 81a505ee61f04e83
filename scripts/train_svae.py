"""Rule `train_svae`: the VAE of garments in rest pose, in one of its variants."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.nets.domains import static_domain
from drapeline.nets.gcvae_training import VaeSettings
from drapeline.nets.runs import train_vae
from drapeline.nets.variants import SVAE_VARIANTS, laid_over
from drapeline.registration.hierarchy import load_hierarchy
from drapeline.registration.static_data import StaticData
from drapeline.registration.topology import load_topology
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    data = StaticData(snakemake.input.data)
    changes = SVAE_VARIANTS[snakemake.wildcards.svae]
    train_vae(
        snakemake.output[0],
        data,
        static_domain(
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
