"""Rule `fit_own_scans`: bodies and garments in a user's segmented scans."""

from importlib import import_module
from typing import TYPE_CHECKING

import torch

from drapeline.bodies.settings import BodyFit
from drapeline.dataset.scans import read_scans
from drapeline.dataset.segmented_scans import save_scans, segment_scans
from drapeline.generation.moving_sheets import make_draper
from drapeline.metrics.predictions import save_fitted_scans
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.scans.garments import find_in_scans, shown_scan, write_found
from drapeline.models.smplicit.settings import FitScan, Meshing
from drapeline.report.models.scans import OWN
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params, made = snakemake.input, snakemake.params, snakemake.output
    torch.set_num_threads(snakemake.threads)
    models = {model.name: model for model in map(SmplicitModel, given.models)}
    bodies = next(iter(models.values())).bodies
    read = read_scans(given.points, given.body, bodies, up=params.up, fps=params.fps)
    scans = segment_scans(read, params.garments, name=given.points)
    settings = FitScan(**params.fit)
    fits = BodyFit(**params.body), settings, Meshing(**params.meshing), params.seed
    solver = import_module(params.solver).cloth_solver(snakemake.threads)
    draper = make_draper(solver, settings.hang_frames, **params.hanging)
    found = find_in_scans(scans, models, *fits, draper)
    write_found(made.folder, scans, found)
    save_scans(made.scans, scans, [one.body for one in found])
    save_fitted_scans(
        made.shown,
        {scan.name: shown_scan(one, OWN) for scan, one in zip(scans, found, strict=True)},
    )
