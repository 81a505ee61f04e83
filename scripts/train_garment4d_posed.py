"""Rule `train_garment4d_posed`: the network of displacements, in one of its variants; or MGN*."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.learning_data.sequences import SequenceData
from drapeline.models.garment4d.data import BodySequences, BodySet
from drapeline.models.garment4d.stages import (
    CanonicalStage,
    MgnStage,
    PosedStage,
    load_stage,
    save_posed_files,
    train_stage,
)
from drapeline.models.training.module import fastest_device
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params = snakemake.input, snakemake.params
    bodies = {gender: load_body(given[gender]) for gender in GENDERS}
    stage = MgnStage if snakemake.wildcards.posed == "mgn" else PosedStage
    device = fastest_device(params.trainer["accelerator"])
    canonical = load_stage(given.canonical, CanonicalStage).to(device)
    settings = stage.SETTINGS(**params.settings)
    sequences = BodySequences(SequenceData(given.data), BodySet(bodies, params.body_points))

    def complete(folder):
        if stage is not MgnStage:  # a baseline to compare with, not to be used
            save_posed_files(folder, sequences, settings.skinning)

    train_stage(
        snakemake.output[0],
        stage(settings, canonical),
        sequences,
        code=params.code,
        progress=params.progress,
        trainer=params.trainer,
        threads=snakemake.threads,
        complete=complete,
    )
