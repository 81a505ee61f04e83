"""Rule `evaluate_garment4d`: metrics of all networks of one garment type, and reconstructions."""

from typing import TYPE_CHECKING

import torch

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.metrics.table import write_metrics
from drapeline.models.garment4d.body_input import BodySet
from drapeline.models.garment4d.canonical_stage import CanonicalStage, PointNetStage
from drapeline.models.garment4d.data import SequenceData
from drapeline.models.garment4d.evaluate import EvaluationSettings, evaluate
from drapeline.models.garment4d.load import load_stage
from drapeline.models.garment4d.posed_stage import MgnStage, PosedStage
from drapeline.models.garment4d.refine import RefineSettings
from drapeline.models.garment4d.settings import settings_of
from drapeline.models.training.module import fastest_device
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params = snakemake.input, snakemake.params
    torch.set_num_threads(snakemake.threads)
    bodies = {gender: load_body(given[gender]) for gender in GENDERS}
    device = fastest_device()
    wearers = BodySet(bodies, params.body_points)
    stages = {
        variant: load_stage(folder, PosedStage).to(device)
        for variant, folder in zip(params.posed, given.posed, strict=True)
    }
    released = given.get("vertex_sampled")
    rows = evaluate(
        SequenceData(given.data, wearers),
        {
            "canonical": load_stage(given.canonical, CanonicalStage).to(device),
            "pointnet": load_stage(given.pointnet, PointNetStage).to(device),
        },
        {**stages, "mgn": load_stage(given.mgn, MgnStage).to(device)},
        params.splits,
        settings_of(EvaluationSettings, params.settings),
        settings_of(RefineSettings, params.refine),
        pictures=snakemake.output.pictures,
        vertex_sampled=None if released is None else SequenceData(released, wearers),
    )
    write_metrics(snakemake.output.metrics, rows)
