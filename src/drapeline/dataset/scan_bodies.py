"""The bodies in segmented scans."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from drapeline.bodies.model import BodyModel
from drapeline.bodies.moved_body import BodyState
from drapeline.bodies.scan_fit import fit_body, fit_sequence
from drapeline.bodies.settings import BodyFit
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import read_record
from drapeline.dataset.segmented_scans import SegmentedScan, save_scans, scan_sample
from drapeline.dataset.settings import ScanSettings
from drapeline.outfits.garment_types import BODY, LABELS
from drapeline.seeding import rng_for


def fit_scan_body(scan: SegmentedScan, model: BodyModel, settings: BodyFit, seed: int) -> BodyState:
    """The body in a scan that has an estimate of it; see `drapeline.bodies.scan_fit`."""
    rng = rng_for(seed, "scan body", scan.name)
    return fit_body(model, scan.points, scan.skin, scan.estimate, scan.joints, settings, rng)


def fit_window_body(
    scan: SegmentedScan, model: BodyModel, seed: int
) -> tuple[SegmentedScan, BodyState]:
    """The body in a scan with a window, fitted to all of its frames; the window has it then."""
    window, skin = scan.window, LABELS.index(BODY)
    assert window is not None
    fitted = fit_sequence(
        model,
        window.points,
        window.labels == skin,
        window.poses,
        scan.estimate.shape,
        rng_for(seed, "scan body", scan.name),
    )
    window = window.shifted(fitted.shift)._replace(poses=fitted.poses)
    place = scan.estimate.trans + fitted.shift
    state = BodyState.of(fitted.poses[window.middle], place, fitted.shape)
    return replace(scan, window=window), state


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
        for scan in taken:
            if settings.body_is_known:
                body = scan.estimate
            elif scan.window is None:
                body = fit_scan_body(scan, model, fit, seed)
            else:
                scan, body = fit_window_body(scan, model, seed)
            scans.append(scan)
            bodies.append(body)
    save_scans(path, scans, bodies)
