"""Rule `train_garment4d_posed`: the network of displacements, in one of its variants; or MGN*."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.learning_data.sequences import SequenceData
from drapeline.models.garment4d.body_input import BodySet
from drapeline.models.garment4d.canonical_stage import CanonicalStage
from drapeline.models.garment4d.load import load_stage
from drapeline.models.garment4d.posed_stage import MgnStage, PosedStage
from drapeline.models.garment4d.train import train_stage
from drapeline.models.garment4d.variants import POSED_VARIANTS
from drapeline.models.garment4d.windows import BodySequences
from drapeline.models.training.module import fastest_device
from drapeline.models.training.settings import override_settings
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params, variant = snakemake.input, snakemake.params, snakemake.wildcards.posed
    bodies = {gender: load_body(given[gender]) for gender in GENDERS}
    settings = override_settings(params.settings, POSED_VARIANTS.get(variant, {}))
    stage = MgnStage if variant == "mgn" else PosedStage
    canonical = load_stage(given.canonical, CanonicalStage).to(fastest_device())
    train_stage(
        snakemake.output[0],
        stage(stage.parse(settings), canonical),
        BodySequences(SequenceData(given.data), BodySet(bodies, params.body_points)),
        code=params.code,
        progress=params.progress,
        trainer=params.trainer,
        threads=snakemake.threads,
    )
