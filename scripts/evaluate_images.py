"""Rule `evaluate_images`: garments found in pictures of held-out samples, with their metrics."""

from pathlib import Path
from typing import TYPE_CHECKING

import torch

from drapeline.dataset.reader import Sample
from drapeline.metrics.table import write_metrics
from drapeline.models.smplicit.evaluate_images import (
    PictureEvaluation,
    PictureSettings,
    take_pictures,
)
from drapeline.models.smplicit.fit_images import FitImage
from drapeline.models.smplicit.model import Meshing, SmplicitModel
from drapeline.rule_log import rule_log
from drapeline.storage import atomic_folder

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params, made = snakemake.input, snakemake.params, snakemake.output
    torch.set_num_threads(snakemake.threads)
    models = {model.name: model for model in map(SmplicitModel, given.models)}
    taken = PictureSettings(**params.pictures)
    pictures = take_pictures([*map(Sample, given.samples)], models, taken, params.seed)
    evaluation = PictureEvaluation(
        models, fit=FitImage(**params.fit), meshing=Meshing(**params.meshing), seed=params.seed
    )
    rows, shown = evaluation.run(pictures, params.split)
    write_metrics(made.metrics, rows)
    with atomic_folder(made.shown) as scratch:
        for picture in shown:
            picture.save(Path(scratch) / f"{picture.name}.npz")
