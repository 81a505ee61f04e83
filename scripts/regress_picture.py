"""Rule `regress_picture`: garments of one picture from the network, at rest and as worn."""

from importlib import import_module
from typing import TYPE_CHECKING

import torch

from drapeline.bodies.model import load_bodies
from drapeline.generation.moving_sheets import make_draper
from drapeline.models.gcvae.pictures.model import PictureModel
from drapeline.models.pictures.dressed import drape_outfit, shown_picture, write_fitted
from drapeline.models.pictures.read import read_picture
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given, params, made = snakemake.input, snakemake.params, snakemake.output
    torch.set_num_threads(snakemake.threads)
    bodies = load_bodies(given)
    model = PictureModel(given.network, given.model, bodies)
    picture = read_picture(given.picture, bodies, least_px=params.least_px)
    people = model.dress(picture)
    solver = import_module(params.solver).cloth_solver(snakemake.threads)
    draper = make_draper(solver, params.hang_frames, **params.hanging)
    if draper:
        people = [
            drape_outfit(outfit, person, bodies, draper) or outfit
            for person, outfit in zip(picture.people, people, strict=True)
        ]
    write_fitted(made.folder, picture, people)
    shown_picture(picture, bodies, people).save(made.shown)
    log.info("%s: %s", picture.name, "; ".join(" + ".join(outfit) for outfit in people))
