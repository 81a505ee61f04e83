"""Rule `evaluate_scans_smplicit`: SMPLicit's garments in scans of held-out samples."""

from importlib import import_module
from typing import TYPE_CHECKING

import torch

from drapeline.bodies.settings import BodyFit
from drapeline.dataset.shards import samples_of
from drapeline.generation.moving_sheets import make_draper
from drapeline.metrics.predictions import BODY, save_fitted_scans
from drapeline.metrics.table import join, write_metrics
from drapeline.models.compare import body_rows, compare_scan_fits, known_scans, skin_of, truth_shown
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.scans.garments import ON_JOINT_BODY, SmplicitScanFitter
from drapeline.models.smplicit.settings import FitScan, Meshing
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params, made = snakemake.input, snakemake.params, snakemake.output
    torch.set_num_threads(snakemake.threads)
    models = {model.name: model for model in map(SmplicitModel, given.models)}
    bodies = next(iter(models.values())).bodies
    scans = known_scans(given.scans, samples_of(given.samples), bodies)
    settings = FitScan(**params.fit)
    fits = BodyFit(**params.body), settings, Meshing(**params.meshing), params.seed
    solver = import_module(params.solver).cloth_solver(snakemake.threads)
    draper = make_draper(solver, settings.hang_frames, **params.hanging)
    fitter = SmplicitScanFitter(models, *fits, draper)
    about = {"split": params.split, "seed": params.seed}
    rows, found = compare_scan_fits(scans, fitter, **about)
    states = {
        "scan_body_estimated": [known.scan.estimate for known in scans],
        "scan_body_fitted": [known.body for known in scans],
        "scan_body_joint": [fitter.bodies[known.scan.name] for known in scans],
    }
    write_metrics(made.metrics, join([rows, body_rows(scans, states, bodies, **about)]))
    shown = {}
    for known in scans:
        scan = known.scan
        own = {BODY: skin_of(fitter.bodies[scan.name], bodies[scan.gender])}
        fitted = {
            variant: {**garments, **own} if variant in ON_JOINT_BODY else garments
            for variant, garments in found[scan.name].items()
        }
        shown[scan.name] = {**fitted, **truth_shown(known, bodies)}
    save_fitted_scans(made.shown, shown)
