"""The bodies in segmented scans."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from drapeline.bodies.model import BodyModel
from drapeline.bodies.moved_body import BodyState
from drapeline.bodies.scan_fit import fit_body
from drapeline.bodies.settings import BodyFit
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import read_record
from drapeline.dataset.segmented_scans import SegmentedScan, save_scans, scan_sample
from drapeline.dataset.settings import ScanSettings
from drapeline.seeding import rng_for


def fit_scan_body(scan: SegmentedScan, model: BodyModel, settings: BodyFit, seed: int) -> BodyState:
    """The body in a scan that has an estimate of it; see `drapeline.bodies.scan_fit`."""
    rng = rng_for(seed, "scan body", scan.name)
    return fit_body(model, scan.points, scan.skin, scan.estimate, scan.joints, settings, rng)


def scan_samples(
    path: str | Path,
    samples: Iterable[str | Path],
    models: Mapping[str, BodyModel],
    *,
    settings: ScanSettings,
    fit: BodyFit,
    seed: int,
) -> None:
    """Write scans of simulated samples and the bodies that fit them; of rejected ones, none.

    Args:
        path: the `.npz`.
        samples: their folders.
        models: of bodies, by gender.
    """
    scans, bodies = [], []
    for folder in filter(lambda folder: read_record(folder).accepted, samples):
        with Sample(folder) as sample:
            model = models[sample.gender]
            taken = scan_sample(sample, model, settings, seed)
        scans += taken
        bodies += [fit_scan_body(scan, model, fit, seed) for scan in taken]
    save_scans(path, scans, bodies)
