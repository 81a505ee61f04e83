"""Rule `train_garment4d_posed`: the network of displacements, in one of its variants; or MGN*."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.models.garment4d.body_input import BodySet
from drapeline.models.garment4d.canonical_stage import CanonicalStage
from drapeline.models.garment4d.data import SequenceData
from drapeline.models.garment4d.load import load_stage
from drapeline.models.garment4d.train import train_posed
from drapeline.models.garment4d.variants import POSED_VARIANTS
from drapeline.models.gcvae.variants import laid_over
from drapeline.models.training.module import fastest_device
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params, variant = snakemake.input, snakemake.params, snakemake.wildcards.posed
    bodies = {gender: load_body(given[gender]) for gender in GENDERS}
    train_posed(
        snakemake.output[0],
        SequenceData(given.data, BodySet(bodies, params.body_points)),
        laid_over(params.settings, POSED_VARIANTS.get(variant, {})),
        load_stage(given.canonical, CanonicalStage).to(fastest_device()),
        mgn=variant == "mgn",
        code=params.code,
        progress=params.progress,
        trainer=params.trainer,
        threads=snakemake.threads,
    )
