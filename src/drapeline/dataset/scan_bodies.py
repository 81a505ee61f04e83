"""The bodies in segmented scans."""

from drapeline.bodies.model import BodyModel
from drapeline.bodies.moved_body import BodyState
from drapeline.bodies.scan_fit import BodyFit, fit_body
from drapeline.dataset.segmented_scans import SegmentedScan
from drapeline.seeding import rng_for


def fit_scan_body(scan: SegmentedScan, model: BodyModel, settings: BodyFit, seed: int) -> BodyState:
    """The body in a scan; see `drapeline.bodies.scan_fit`.

    Args:
        scan: with an estimate of the body.
        model: of the wearer's body.
        settings: of the fit.
        seed: of the points that count.
    """
    rng = rng_for(seed, "scan body", scan.name)
    return fit_body(model, scan.points, scan.skin, scan.estimate, scan.joints, settings, rng)
