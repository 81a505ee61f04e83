"""Rule `fit_picture`: the garments of the people in one picture, at rest and as worn."""

from importlib import import_module
from typing import TYPE_CHECKING

import torch

from drapeline.generation.moving_sheets import make_draper
from drapeline.models.pictures.dressed import shown_picture, write_fitted
from drapeline.models.pictures.read import read_picture
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.pictures.drape import drape_picture
from drapeline.models.smplicit.pictures.garments import fit_picture
from drapeline.models.smplicit.settings import FitImage, Meshing
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given, params, made = snakemake.input, snakemake.params, snakemake.output
    torch.set_num_threads(snakemake.threads)
    models = {model.name: model for model in map(SmplicitModel, given.models)}
    bodies = next(iter(models.values())).bodies
    settings = FitImage(**params.fit)
    picture = read_picture(given.picture, bodies, least_px=settings.least_px)
    how = models, settings, Meshing(**params.meshing), params.seed
    people = fit_picture(picture, *how)
    solver = import_module(params.solver).cloth_solver(snakemake.threads)
    draper = make_draper(solver, settings.hang_frames, **params.hanging)
    if draper:
        people = drape_picture(picture, people, *how, draper)
    write_fitted(made.folder, picture, people)
    shown_picture(picture, bodies, people).save(made.shown)
    log.info("%s: %s", picture.name, "; ".join(" + ".join(outfit) for outfit in people))
