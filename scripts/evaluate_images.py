"""Rule `evaluate_images`: garments found in pictures of held-out samples, with their metrics."""

from pathlib import Path
from typing import TYPE_CHECKING

import torch

from drapeline.dataset.record import read_record
from drapeline.dataset.shards import samples_of_shards
from drapeline.errors import InputError
from drapeline.generation.moving_sheets import make_draper
from drapeline.metrics.table import write_metrics
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.pictures.evaluate import PictureEvaluation, take_pictures
from drapeline.models.smplicit.settings import FitImage, Meshing
from drapeline.rule_log import rule_log
from drapeline.storage import atomic_folder
from drapeline.xpbd.solver import cloth_solver

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params, made = snakemake.input, snakemake.params, snakemake.output
    torch.set_num_threads(snakemake.threads)
    models = {model.name: model for model in map(SmplicitModel, given.models)}
    chosen = [p for p in samples_of_shards(given.learning) if p.name in params.learning_samples]
    dataset, learning = (
        [folder for folder in folders if read_record(folder).accepted]
        for folders in (given.samples, chosen)
    )
    if not dataset and not learning:
        raise InputError(
            f"all {len(given.samples) + len(chosen)} samples of the {params.split} split that"
            " pictures were wanted of were rejected, expected one that is accepted"
        )
    about = {"size_px": params.size_px, "seed": params.seed}
    pictures = take_pictures(dataset, models, count=params.dataset_pictures, **about)
    pictures += take_pictures(learning, models, count=len(learning), **about)
    fit, solver = FitImage(**params.fit), cloth_solver(snakemake.threads)
    evaluation = PictureEvaluation(
        models,
        fit=fit,
        meshing=Meshing(**params.meshing),
        seed=params.seed,
        draper=make_draper(solver, fit.hang_frames, **params.hanging),
    )
    rows, shown = evaluation.run(pictures, params.split)
    write_metrics(made.metrics, rows)
    with atomic_folder(made.shown) as scratch:
        for picture in shown:
            picture.save(Path(scratch) / f"{picture.name}.npz")
