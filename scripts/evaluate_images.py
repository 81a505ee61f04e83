"""Rule `evaluate_images`: garments found in pictures of held-out samples, with their metrics."""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from drapeline.dataset.record import read_record
from drapeline.dataset.shards import samples_named
from drapeline.errors import InputError
from drapeline.generation.moving_sheets import make_draper
from drapeline.metrics.table import write_metrics
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.pictures.evaluate import PictureEvaluation, take_pictures
from drapeline.models.smplicit.settings import FitImage, Meshing
from drapeline.rule_log import rule_log
from drapeline.storage import atomic_folder

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params, made = snakemake.input, snakemake.params, snakemake.output
    torch.set_num_threads(snakemake.threads)
    models = {model.name: model for model in map(SmplicitModel, given.models)}
    spread, others = (
        [path for path in samples_named(given.samples, names) if read_record(path).accepted]
        for names in (params.samples, params.others)
    )
    if not spread and not others:
        raise InputError(
            f"all {len(params.samples) + len(params.others)} samples of the {params.split} split"
            " that pictures were wanted of were rejected, expected one that is accepted"
        )
    about = {"size_px": params.size_px, "seed": params.seed}
    pictures = take_pictures(spread, models, count=params.pictures, **about)
    pictures += take_pictures(others, models, count=len(others), **about)
    fit = FitImage(**params.fit)
    solver = import_module(params.solver).cloth_solver(snakemake.threads)
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
