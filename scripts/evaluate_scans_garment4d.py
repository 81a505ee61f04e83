"""Rule `evaluate_scans_garment4d`: Garment4D's components and networks in held-out scans."""

from typing import TYPE_CHECKING

import torch

from drapeline.bodies.model import load_body
from drapeline.dataset.shards import samples_of
from drapeline.frames import GENDERS
from drapeline.metrics.predictions import save_fitted_scans
from drapeline.metrics.table import write_metrics
from drapeline.models.compare import compare_scan_fits, known_scans
from drapeline.models.garment4d.reconstruct import ReconstructionModel
from drapeline.models.garment4d.scans import FitTemplate, Garment4dScanFitter
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params, made = snakemake.input, snakemake.params, snakemake.output
    torch.set_num_threads(snakemake.threads)
    bodies = {gender: load_body(given[gender]) for gender in GENDERS}
    models = {model.garment: model for model in map(ReconstructionModel, given.models)}
    scans = known_scans(given.scans, samples_of(given.samples), bodies)
    fitter = Garment4dScanFitter(models, FitTemplate(), params.seed)
    rows, found = compare_scan_fits(scans, fitter, split=params.split, seed=params.seed)
    write_metrics(made.metrics, rows)
    save_fitted_scans(made.shown, found)
