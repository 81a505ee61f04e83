"""SMPLicit's garments in scans whose garments and bodies are known, fit by fit."""

from collections.abc import Mapping

import torch

from drapeline.bodies.model import BodyModel, load_bodies
from drapeline.bodies.moved_body import BodyState
from drapeline.bodies.settings import BodyFit
from drapeline.dataset.segmented_scans import SegmentedScan
from drapeline.dataset.shards import samples_of
from drapeline.generation.moving_sheets import job_draper
from drapeline.geometry.mesh import Mesh
from drapeline.job import Job
from drapeline.metrics.predictions import BODY
from drapeline.metrics.table import join
from drapeline.models.compare import (
    SCANNED,
    body_rows,
    compare_frames,
    known_scans,
    skin_of,
    truth_shown,
    write_frames,
)
from drapeline.models.compare import move_garments as move_true_garments
from drapeline.models.contract import MovingPerson, Stopwatch
from drapeline.models.pictures.dressed import Draper, use_draped
from drapeline.models.smplicit.gallery.motion import SKINNINGS, repose
from drapeline.models.smplicit.garments import MODEL_OF_GARMENT
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.scans.fit import fit_scan
from drapeline.models.smplicit.scans.garments import (
    decode_in_scan,
    drape_garments,
    drape_scan,
    move_garments,
)
from drapeline.models.smplicit.settings import FitScan, Meshing

START, NEAREST, CODE, JOINT, MOVED = (
    f"smplicit_scan_{name}" for name in ("start", "nearest", "code", "joint", "moved")
)
NEAREST_HUNG, HUNG, HUNG_MOVED = (
    f"smplicit_scan_{name}" for name in ("nearest_hung", "hung", "hung_moved")
)
ON_JOINT_BODY = frozenset([JOINT, MOVED, HUNG, HUNG_MOVED])
# What begins with a way of finding garments.
_AFTER = {NEAREST: [NEAREST_HUNG], JOINT: [MOVED, HUNG, HUNG_MOVED]}
_FITTED = NEAREST, CODE, JOINT, MOVED, NEAREST_HUNG, HUNG, HUNG_MOVED


class SmplicitScanFitter:
    """Fulfils `ScanFitter`.

    The start is the mean code of the garment's type on the body as it was estimated. On the fitted
    body there are the training code that fits best, and the fitted code. Body and codes are then
    fitted jointly, and sheets are moved to the points. If there is a draper, the garments hang,
    their codes are fitted to that, see `drape_scan`, and sheets are moved from there; those of the
    training code that fits best hang as well.

    Args:
        models: by their names of `FIELD_MODELS`.
        draper: drapes sheets on bodies; None for skinning alone.

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
        draper: Draper | None = None,
    ) -> None:
        self._models, self._body_fit, self._settings = models, body_fit, settings
        self._meshing, self._seed, self._draper = meshing, seed, draper
        self.watch = Stopwatch()
        self.bodies: dict[str, BodyState] = {}

    def fit(self, scan: SegmentedScan, body: BodyState) -> dict[str, dict[str, Mesh]]:
        """The garments of the start and of each fit."""
        self.bodies[scan.name] = body
        names = [name for name in scan.garments if MODEL_OF_GARMENT[name] in self._models]
        if not names:
            return {}
        with self.watch.of(*_FITTED):
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
        dressed = {}
        for variant, way in ways.items():
            with self.watch.of(variant, *_AFTER.get(variant, ())):
                dressed[variant] = decode_in_scan(scan, self._models, *way, self._meshing)
        wearer, garments = dressed[JOINT]
        outfits = {variant: found_garments for variant, (_, found_garments) in dressed.items()}
        with self.watch.of(MOVED):
            moved = {MOVED: move_garments(scan, garments, wearer)}
        if self._draper:
            nearest = outfits[NEAREST]
            with self.watch.of(NEAREST_HUNG):
                draped = drape_garments(scan, self._models, nearest, body, self._draper)
                outfits[NEAREST_HUNG] = use_draped(nearest, draped)
            how = self._settings, self._meshing, self._seed, self._draper
            with self.watch.of(HUNG, HUNG_MOVED):
                outfits[HUNG] = drape_scan(scan, self._models, found, garments, *how)
            with self.watch.of(HUNG_MOVED):
                moved[HUNG_MOVED] = move_garments(scan, outfits[HUNG], wearer)
        worn = {
            variant: {name: garment.posed for name, garment in outfit.items()}
            for variant, outfit in outfits.items()
        }
        return worn | moved


def fit_to_scans(job: Job) -> None:
    """SMPLicit's garments in scans of held-out samples, and the bodies in them."""
    given, params = job.input, job.params
    torch.set_num_threads(job.threads)
    models = {model.name: model for model in map(SmplicitModel, given.models)}
    bodies = next(iter(models.values())).bodies
    scans = known_scans(given.scans, samples_of(given.samples), bodies)
    settings = FitScan(**params.fit)
    fits = BodyFit(**params.body), settings, Meshing(**params.meshing), params.seed
    fitter = SmplicitScanFitter(models, *fits, job_draper(job, settings.hang_frames))
    about = {"model": SCANNED[params.kind], "split": params.split, "seed": params.seed}
    rows, found, costs = compare_frames(
        scans,
        lambda known: fitter.fit(known.scan, known.body),
        fitter.watch,
        garments=params.garments,
        **about,
    )
    states = {
        "scan_body_estimated": [known.scan.estimate for known in scans],
        "scan_body_fitted": [known.body for known in scans],
        "scan_body_joint": [fitter.bodies[known.scan.name] for known in scans],
    }
    shown = {}
    for known in scans:
        scan = known.scan
        own = {BODY: skin_of(fitter.bodies[scan.name], bodies[scan.gender])}
        fitted = {
            variant: {**garments, **own} if variant in ON_JOINT_BODY else garments
            for variant, garments in found[scan.name].items()
        }
        shown[scan.name] = {**fitted, **truth_shown(known, bodies)}
    rows = join([rows, body_rows(scans, states, bodies, **about)])
    write_frames(job.output[0], rows, shown, costs)


class SkinningMover:
    """Fulfils `Mover` with the paper's skinning, and with smoothed weights.

    Args:
        bodies: by gender.
    """

    def __init__(self, bodies: Mapping[str, BodyModel]) -> None:
        self.watch = Stopwatch()
        self._bodies = bodies

    def move(self, person: MovingPerson) -> dict[str, dict[str, Mesh]]:
        """All garments."""
        body, shape, pose = self._bodies[person.gender], person.shape, person.poses[-1:]
        found: dict[str, dict[str, Mesh]] = {}
        for skinning in SKINNINGS:
            moved = found[f"moved_{skinning}"] = {}
            with self.watch.of(f"moved_{skinning}"):
                for name, rest in person.rest.items():
                    (points,) = repose(rest, body, shape, pose, skinning=skinning)
                    moved[name] = Mesh(points, rest.faces)
        return found


def move_garments_at_rest(job: Job) -> None:
    """True garments at rest, moved by skinning."""
    bodies = load_bodies(job.input)
    move_true_garments(job, SkinningMover(bodies), bodies)
