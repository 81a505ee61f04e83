"""Rule `scan_sample`: segmented scans of a simulated sample, with the bodies that fit them."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.bodies.scan_fit import BodyFit
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import read_record
from drapeline.dataset.scan_bodies import fit_scan_body
from drapeline.dataset.segmented_scans import (
    ScanSettings,
    save_scans,
    scan_sample,
)
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params, scans = snakemake.input, snakemake.params, []
    model = load_body(given.body)
    if read_record(given.sample).accepted:
        with Sample(given.sample) as sample:
            scans = scan_sample(sample, model, ScanSettings(**params.scans), params.seed)
    settings = BodyFit(**params.body)
    bodies = [fit_scan_body(scan, model, settings, params.seed) for scan in scans]
    save_scans(snakemake.output[0], scans, bodies)
