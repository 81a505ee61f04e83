"""Rule `scan_learning`: segmented scans of samples of the learning group, with bodies."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.bodies.scan_fit import BodyFit
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import read_record
from drapeline.dataset.scan_bodies import fit_scan_body
from drapeline.dataset.segmented_scans import ScanSettings, save_scans, scan_sample
from drapeline.frames import GENDERS
from drapeline.rule_log import progress, rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params, scans, bodies = snakemake.input, snakemake.params, [], []
    models = {gender: load_body(given[gender]) for gender in GENDERS}
    settings, fit = ScanSettings(**params.scans), BodyFit(**params.body)
    accepted = [folder for folder in params.samples if read_record(folder).accepted]
    for folder in progress(accepted, total=len(accepted), label="samples"):
        with Sample(folder) as sample:
            model = models[sample.gender]
            taken = scan_sample(sample, model, settings, params.seed)
        scans += taken
        bodies += [fit_scan_body(scan, model, fit, params.seed) for scan in taken]
    save_scans(snakemake.output[0], scans, bodies)
