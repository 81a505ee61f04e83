"""SMPLicit's garments in segmented scans, beside its own trivial answers."""

from collections.abc import Mapping

import numpy as np

from drapeline.bodies.follow import pose_body
from drapeline.bodies.moved_body import BodyState
from drapeline.dataset.segmented_scans import SegmentedScan
from drapeline.geometry.mesh import Mesh
from drapeline.models.smplicit.fit_pictures import FittedGarment, Wearer, dress
from drapeline.models.smplicit.fit_scans import FitScan, fit_scan
from drapeline.models.smplicit.model import Meshing, SmplicitModel
from drapeline.models.smplicit.variants import MODEL_OF_GARMENT
from drapeline.outfits.worn import Wearing

START, NEAREST, CODE, JOINT = (
    f"smplicit_scan_{name}" for name in ("start", "nearest", "code", "joint")
)


class SmplicitScanFitter:
    """Fulfils `ScanFitter`.

    The start is the mean code on the body as it was estimated. On the fitted body there are the
    training code that fits best, and the fitted code. In the end body and codes are fitted jointly.

    Args:
        models: by their names of `FIELD_MODELS`.
        settings: of the fit.
        meshing: how sheets are extracted.
        seed: of the points that count.

    Attributes:
        bodies: scan's name -> the body as fitted jointly.
    """

    def __init__(
        self,
        models: Mapping[str, SmplicitModel],
        settings: FitScan,
        meshing: Meshing,
        seed: int,
    ) -> None:
        self._models, self._settings = models, settings
        self._meshing, self._seed = meshing, seed
        self.bodies: dict[str, BodyState] = {}

    def fit(self, scan: SegmentedScan, body: BodyState) -> dict[str, dict[str, Mesh]]:
        """The garments of the start and of each fit."""
        names = [name for name in scan.garments if MODEL_OF_GARMENT[name] in self._models]
        if not names:
            return {}
        found = fit_scan(scan, self._models, body, self._settings, self._seed)
        self.bodies[scan.name] = found.joint.body
        mean = {name: self._models[MODEL_OF_GARMENT[name]].mean_code for name in names}
        ways = {
            START: (mean, scan.estimate),
            NEAREST: (found.nearest.codes, body),
            CODE: (found.code.codes, body),
            JOINT: (found.joint.codes, found.joint.body),
        }
        return {
            variant: {name: one.posed for name, one in self._dress(scan, *way).items()}
            for variant, way in ways.items()
        }

    def _dress(
        self, scan: SegmentedScan, codes: Mapping[str, np.ndarray], body: BodyState
    ) -> dict[str, FittedGarment]:
        return dress_scan(scan, self._models, codes, body, self._meshing)


def dress_scan(
    scan: SegmentedScan,
    models: Mapping[str, SmplicitModel],
    codes: Mapping[str, np.ndarray],
    body: BodyState,
    meshing: Meshing,
) -> dict[str, FittedGarment]:
    """Sheets of codes, at rest and worn in layers by a body in a scan."""
    chosen = {name: (models[MODEL_OF_GARMENT[name]], z) for name, z in codes.items()}
    model = next(iter(chosen.values()))[0].bodies[scan.gender]
    posed = pose_body(model, body.shape, body.pose, body.trans)
    return dress(posed, Wearer(scan.gender, body.shape), chosen, Wearing(), meshing)
