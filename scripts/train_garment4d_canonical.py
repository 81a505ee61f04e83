"""Rule `train_garment4d_canonical`: a garment's points and its shape at rest; or PN++."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.learning_data.sequences import SequenceData
from drapeline.models.garment4d.data import BodySequences, BodySet
from drapeline.models.garment4d.stages import CanonicalStage, PointNetStage, train_stage
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params = snakemake.input, snakemake.params
    bodies = {gender: load_body(given[gender]) for gender in GENDERS}
    data = SequenceData(given.data)
    stage = PointNetStage if snakemake.wildcards.canonical == "pointnet" else CanonicalStage
    train_stage(
        snakemake.output[0],
        stage(stage.SETTINGS(**params.settings), data.space, data.label),
        BodySequences(data, BodySet(bodies, params.body_points)),
        code=params.code,
        progress=params.progress,
        trainer=params.trainer,
        threads=snakemake.threads,
    )
