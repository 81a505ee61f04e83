"""Rule `evaluate_garment4d`: metrics of all networks of one garment type, and reconstructions."""

from typing import TYPE_CHECKING

import torch

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.learning_data.sequences import SequenceData
from drapeline.metrics.table import write_metrics
from drapeline.models.garment4d.data import BodySequences, BodySet
from drapeline.models.garment4d.evaluate import evaluate
from drapeline.models.garment4d.settings import EvaluationSettings
from drapeline.models.garment4d.stages import (
    CanonicalStage,
    MgnStage,
    PointNetStage,
    PosedStage,
    load_posed_files,
    load_stage,
)
from drapeline.models.training.module import fastest_device
from drapeline.registration.settings import RefineSettings
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params = snakemake.input, snakemake.params
    torch.set_num_threads(snakemake.threads)
    models = {gender: load_body(given[gender]) for gender in GENDERS}
    bodies, device = BodySet(models, params.body_points), fastest_device(params.accelerator)
    posed = dict(zip(params.posed, given.posed, strict=True))
    stages = {name: load_stage(folder, PosedStage).to(device) for name, folder in posed.items()}
    released = given.get("vertex_sampled")
    rows = evaluate(
        BodySequences(SequenceData(given.data), bodies),
        {
            "canonical": load_stage(given.canonical, CanonicalStage).to(device),
            "pointnet": load_stage(given.pointnet, PointNetStage).to(device),
        },
        {**stages, "mgn": load_stage(given.mgn, MgnStage).to(device)},
        params.splits,
        EvaluationSettings(**params.settings),
        RefineSettings(**params.refine),
        load_posed_files(posed["posed"]).worn_statistics,
        pictures=snakemake.output.pictures,
        vertex_sampled=BodySequences(SequenceData(released), bodies) if released else None,
    )
    write_metrics(snakemake.output.metrics, rows)
