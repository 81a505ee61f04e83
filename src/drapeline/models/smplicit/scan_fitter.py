"""SMPLicit's garments in segmented scans, beside its own trivial answers."""

from collections.abc import Mapping

from drapeline.bodies.moved_body import BodyState
from drapeline.bodies.settings import BodyFit
from drapeline.dataset.segmented_scans import SegmentedScan
from drapeline.geometry.mesh import Mesh
from drapeline.models.smplicit.fit_scans import fit_scan
from drapeline.models.smplicit.hanging import Hang, as_hung
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.own_scans import (
    dress_scan,
    hang_garments,
    hang_scan,
    move_garments,
)
from drapeline.models.smplicit.settings import FitScan, Meshing
from drapeline.models.smplicit.variants import MODEL_OF_GARMENT

START, NEAREST, CODE, JOINT, MOVED = (
    f"smplicit_scan_{name}" for name in ("start", "nearest", "code", "joint", "moved")
)
NEAREST_HUNG, HUNG, HUNG_MOVED = (
    f"smplicit_scan_{name}" for name in ("nearest_hung", "hung", "hung_moved")
)


ON_JOINT_BODY = frozenset([JOINT, MOVED, HUNG, HUNG_MOVED])


class SmplicitScanFitter:
    """Fulfils `ScanFitter`.

    The start is the mean code of the garment's type on the body as it was estimated. On the fitted
    body there are the training code that fits best, and the fitted code. Body and codes are then
    fitted jointly, and sheets are moved to the points. If there is something to hang them, the
    garments hang, their codes are fitted to that, see `hang_scan`, and sheets are moved from there;
    those of the training code that fits best hang as well.

    Args:
        models: by their names of `FIELD_MODELS`.
        body_fit, settings: of the fits.
        meshing: how sheets are extracted.
        seed: of the points that count.
        hang: hangs sheets on bodies; None for skinning alone.

    Attributes:
        bodies: scan's name -> the body as fitted jointly.
    """

    def __init__(
        self,
        models: Mapping[str, SmplicitModel],
        body_fit: BodyFit,
        settings: FitScan,
        meshing: Meshing,
        seed: int,
        hang: Hang | None = None,
    ) -> None:
        self._models, self._body_fit, self._settings = models, body_fit, settings
        self._meshing, self._seed, self._hang = meshing, seed, hang
        self.bodies: dict[str, BodyState] = {}

    def fit(self, scan: SegmentedScan, body: BodyState) -> dict[str, dict[str, Mesh]]:
        """The garments of the start and of each fit."""
        self.bodies[scan.name] = body
        names = [name for name in scan.garments if MODEL_OF_GARMENT[name] in self._models]
        if not names:
            return {}
        found = fit_scan(scan, self._models, body, self._body_fit, self._settings, self._seed)
        self.bodies[scan.name] = found.joint.body
        mean = {
            name: self._models[MODEL_OF_GARMENT[name]].codes_of(name).mean(axis=0) for name in names
        }
        ways = {
            START: (mean, scan.estimate),
            NEAREST: (found.nearest.codes, body),
            CODE: (found.code.codes, body),
            JOINT: (found.joint.codes, found.joint.body),
        }
        dressed = {
            variant: dress_scan(scan, self._models, *way, self._meshing)
            for variant, way in ways.items()
        }
        wearer, garments = dressed[JOINT]
        outfits = {variant: found_garments for variant, (_, found_garments) in dressed.items()}
        moved = {MOVED: move_garments(scan, garments, wearer)}
        if self._hang:
            nearest = outfits[NEAREST]
            hung = hang_garments(scan, self._models, nearest, body, self._hang)
            outfits[NEAREST_HUNG] = as_hung(nearest, hung)
            how = self._settings, self._meshing, self._seed, self._hang
            outfits[HUNG] = hang_scan(scan, self._models, found, garments, *how)
            moved[HUNG_MOVED] = move_garments(scan, outfits[HUNG], wearer)
        worn = {
            variant: {name: garment.posed for name, garment in outfit.items()}
            for variant, outfit in outfits.items()
        }
        return worn | moved
