"""Codes of the garments in a scan, and the body under them (SMPLicit 4.2, equation 5).

The points of a scan are moved back to the rest pose by the body, where each garment's field has to
have the distances that the points have from the garment's. Codes come first, from the training code
that fits best, with the body as it is; then codes and body together.

As in the fit of codes to known fields, absolute differences are minimised as weighted squares by
damped Gauss-Newton steps. The network is gone through backwards once for all derivatives: what the
point, the wearer's shape and the code change in it are sums in its first layers.

The paper's prior is |z|; here it is the mean square of w, see `CodePrior`. Beyond the paper, codes
can be fitted once more to garments that hang on the body that was found, see `fit_to_cloth`.

P points, H and H0 sums of the decoder's first query layer and first joint layer, Z numbers of a
code, U unknowns of the body.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import torch

from drapeline.bodies.follow import add_cloth, move_to_rest, pose_body
from drapeline.bodies.moved_body import SHAPE, UNKNOWNS, BodyState, MovedBody
from drapeline.bodies.rest_body import SHAPES, shape_basis
from drapeline.bodies.scan_fit import BodyTerms
from drapeline.bodies.settings import BodyFit
from drapeline.dataset.segmented_scans import SegmentedScan
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.geometry.least_squares import LeastSquares, absolute_weights
from drapeline.geometry.mesh import vertex_normals
from drapeline.models.smplicit.garments import MODEL_OF_GARMENT
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.scans.points import FieldPoints, field_points
from drapeline.models.smplicit.settings import FitScan
from drapeline.models.training.optimise import (
    CodePrior,
    Linearised,
    fit_least_squares,
    spread_codes,
)
from drapeline.outfits.worn import DrapedSheet
from drapeline.seeding import rng_for

_FLOOR = 0.1  # of d_max: below it, absolute differences are taken for squares
_DAMPING = 0.1


class FittedScan(NamedTuple):
    """Codes and body found in a scan."""

    codes: dict[str, np.ndarray]  # garment -> (Z,)
    body: BodyState  # that wears them


class ScanFits(NamedTuple):
    """Codes and bodies found in a scan, step by step."""

    nearest: FittedScan  # the training codes that fit best
    code: FittedScan  # fitted codes, on the same body
    joint: FittedScan  # codes and body, fitted jointly


class FieldResiduals(NamedTuple):
    """A field at a scan's points."""

    residual: np.ndarray  # (P,) differences of distances, in units of d_max
    by_place: np.ndarray  # (P, 3) derivatives by the points at rest, per metre
    by_shape: np.ndarray  # (P, 10) derivatives by the wearer's shape, at fixed points
    by_code: np.ndarray  # (P, Z) derivatives by w


class GarmentTerms:
    """Residuals of one garment in a scan.

    Starts and the prior are those of training garments of its type.
    """

    def __init__(
        self,
        model: SmplicitModel,
        garment: str,
        points: FieldPoints,
        gender: str,
        settings: FitScan,
    ) -> None:
        self._network, self._settings = model.network, settings
        self._decoder = model.network.decoder
        self._codes = model.codes_of(garment)
        self.prior = CodePrior.of(self._codes)
        self.points = points
        true = np.minimum(points.distance_m / model.network.d_max_m, 1)
        self._true = torch.from_numpy(true.astype(np.float32))
        start = GENDERS.index(gender) * (1 + SHAPES)
        basis = model.network.place_basis[start : start + 1 + SHAPES]
        self._mean_places, self._basis = basis[0], basis[1:]
        with torch.no_grad():
            weight = self._decoder.fc0_query.weight
            self._bias_by_shape = -(self._basis.flatten(1) @ weight.T)  # (10, H)

    @property
    def numbers(self) -> int:
        """Z."""
        return len(self.prior.mean)

    def evaluate_field(
        self, places: np.ndarray, shape: np.ndarray, w: np.ndarray
    ) -> FieldResiduals:
        """The field of a code at points at rest.

        Args:
            places: (P, 3) metres.
            shape: (10,) of the wearer.
            w: (Z,) of the code.
        """
        first, weight = self._first(places, shape)
        base, slopes = self._base(w)
        with torch.enable_grad():
            hidden = self._decoder.query_of(first.requires_grad_(True)) + base
            predicted = self._decoder.joint(hidden)
            by_first, by_hidden = torch.autograd.grad(predicted.sum(), (first, hidden))
        return FieldResiduals(
            self._residual(predicted),
            (by_first[0] @ weight).numpy().astype(np.float64),
            (by_first[0] @ self._bias_by_shape.T).numpy().astype(np.float64),
            self._by_code(by_hidden, slopes),
        )

    def evaluate_code(self, query: torch.Tensor, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residual, and derivatives by the code, at the points of a `query`."""
        base, slopes = self._base(w)
        with torch.enable_grad():
            hidden = (query + base).requires_grad_(True)
            predicted = self._decoder.joint(hidden)
            (by_hidden,) = torch.autograd.grad(predicted.sum(), hidden)
        return self._residual(predicted), self._by_code(by_hidden, slopes)

    def _base(self, w: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
        """(H0,) what a code adds to the first joint layer, and (H0, Z) derivatives by z."""
        with torch.no_grad():
            z_cut, z_style = self._codes_of(w[None])
            base, slopes = self._decoder.base(z_cut, z_style), self._decoder.base_slopes(z_style)
            return base[0], slopes[0]

    def _residual(self, predicted: torch.Tensor) -> np.ndarray:
        return (predicted.detach()[0] - self._true).numpy().astype(np.float64)

    def _by_code(self, by_hidden: torch.Tensor, slopes: torch.Tensor) -> np.ndarray:
        return (by_hidden[0] @ slopes @ self.prior.factor).numpy().astype(np.float64)

    def _first(self, places: np.ndarray, shape: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
        """(1, P, H) what the first query layer gives at points, and (H, 3) its weights."""
        coefficients = torch.from_numpy(shape.astype(np.float32))
        points = torch.from_numpy(places.astype(np.float32))[None]
        with torch.no_grad():
            clusters = self._mean_places + torch.tensordot(coefficients, self._basis, 1)
            weight, bias = self._decoder.fold(clusters[None])
            return points @ weight.mT + bias[:, None], weight[0]

    def query(self, places: np.ndarray, shape: np.ndarray) -> torch.Tensor:
        """(1, P, H0) what points add to the first joint layer, whatever the code."""
        with torch.no_grad():
            return self._decoder.query_of(self._first(places, shape)[0])

    def _codes_of(self, every: np.ndarray) -> tuple[torch.Tensor, ...]:
        """z_cut and z_style of some w (S, Z)."""
        z = self.prior.codes(torch.from_numpy(every.astype(np.float32)))
        return z.split([self._decoder.cut, self._decoder.style], 1)

    def losses(self, places: np.ndarray, shape: np.ndarray, every: np.ndarray) -> list[float]:
        """The `loss` of each of some w (S, Z) at points (P, 3) at rest, on a body of a shape."""
        query = self.query(places, shape)
        with torch.no_grad():
            bases = self._decoder.base(*self._codes_of(every))
            residuals = [self._residual(self._decoder.joint(query + base)) for base in bases]
        return [self.loss(residual, w) for residual, w in zip(residuals, every, strict=True)]

    def weights(self, residual: np.ndarray) -> np.ndarray:
        """(P,) of the squares of residuals."""
        total = self._settings.weight * self._network.d_max_m / self._settings.field_m
        share = self.points.weight / self.points.weight.sum()
        return total * share * absolute_weights(residual, _FLOOR)

    def loss(self, residual: np.ndarray, w: np.ndarray) -> float:
        """The loss that steps of the code alone make smaller."""
        total = self._settings.weight * self._network.d_max_m / self._settings.field_m
        mean = np.average(np.abs(residual), weights=self.points.weight)
        return float(total * mean + (w**2).sum() / 2)

    def best_start(self, places: np.ndarray, shape: np.ndarray) -> np.ndarray:
        """(Z,) w of the training code, or of their mean, with the least loss."""
        starts = torch.from_numpy(spread_codes(self._codes, self._settings.starts))
        every = self.prior.whiten(starts).numpy().astype(np.float64)
        return every[int(np.argmin(self.losses(places, shape, every)))]

    def fit(self, places: np.ndarray, shape: np.ndarray, w: np.ndarray) -> np.ndarray:
        """(Z,) w that fits points at rest, from a start, on a body that stays as it is."""
        query = self.query(places, shape)

        def linearise(tried: torch.Tensor) -> Linearised:
            w = tried[0].numpy()
            residual, by_code = self.evaluate_code(query, w)
            loss = np.array(self.loss(residual, w))
            parts = residual, by_code, self.weights(residual), np.ones_like(w), loss
            return Linearised(*(torch.from_numpy(part)[None] for part in parts))

        start = torch.from_numpy(w)[None]
        return fit_least_squares(start, linearise, self._settings.steps)[0].numpy()

    def whiten(self, z: np.ndarray) -> np.ndarray:
        """(Z,) the w of a code."""
        w = self.prior.whiten(torch.from_numpy(z.astype(np.float32))[None])
        return w[0].numpy().astype(np.float64)

    def code(self, w: np.ndarray) -> np.ndarray:
        """(Z,) the code of w."""
        return self.prior.codes(torch.from_numpy(w.astype(np.float32))[None])[0].numpy()


class PointsAtRest:
    """Points of a scan moved back to the rest pose, with derivatives by the body.

    A point follows the closest vertices of the posed body, in the paper the closest one.

    Args:
        points: (P, 3) in the scan's world.
        neighbours: K vertices that it follows.

    Attributes:
        places: (P, 3) at rest.
    """

    def __init__(self, points: np.ndarray, body: MovedBody, neighbours: int) -> None:
        state = body.state
        posed = pose_body(body.model, state.shape, state.pose, state.trans)
        self._body, self._moved = body, move_to_rest(points, posed, neighbours)
        self.places = self._moved.places

    def slopes(self, along: np.ndarray, rest_by_shape: np.ndarray) -> np.ndarray:
        """(P, U) derivatives of along . place by the body; which vertices are closest is kept.

        `along` is (P, 3), `rest_by_shape` (10, V, 3) change of the body at rest per unit of shape.
        """
        total, moved = np.zeros((len(along), UNKNOWNS)), self._moved
        for column in range(moved.near.shape[1]):
            ids, share = moved.near[:, column], moved.share[:, column, None]
            back = np.einsum("pab,pa->pb", moved.back[:, column], along)
            points = self._body.points_of_vertices(ids)
            slopes = self._body.slopes(points, back, moved.offsets[:, column])
            total -= share * slopes
            total[:, SHAPE] += share * np.einsum("mpa,pa->pm", rest_by_shape[:, ids], along)
        return total


def fit_scan(
    scan: SegmentedScan,
    models: Mapping[str, SmplicitModel],
    body: BodyState,
    body_fit: BodyFit,
    settings: FitScan,
    seed: int,
) -> ScanFits:
    """Codes of the garments in a scan, with the body kept and with the body fitted again.

    Args:
        models: by their names of `FIELD_MODELS`.
        body: fitted to the scan, see `fit_body`.
        body_fit: how the body is fitted again.

    Raises:
        InputError: no garment is known to a model, or one has too few points.
    """
    wanted = [name for name in scan.garments if MODEL_OF_GARMENT[name] in models]
    if not wanted:
        raise InputError(
            f"{scan.name}: shows {' and '.join(scan.garments)}, expected a garment of the models"
            f" {', '.join(models)}"
        )
    moved, terms = _terms(scan, models, wanted, body, settings, seed)
    starts, codes = {}, {}
    for name, part in terms.items():
        places = PointsAtRest(part.points.places, moved, settings.neighbours).places
        starts[name] = part.best_start(places, body.shape)
        codes[name] = part.fit(places, body.shape, starts[name])
    rng = rng_for(seed, "scan body", scan.name, "jointly")
    body_terms = BodyTerms(scan.points, scan.skin, scan.estimate, scan.joints, body_fit, rng)
    jointly, again = _fit_jointly(body_terms, terms, codes, moved, settings)
    return ScanFits(
        *(
            FittedScan({name: terms[name].code(w) for name, w in every.items()}, state)
            for every, state in ((starts, body), (codes, body), (jointly, again))
        )
    )


def fit_to_cloth(
    scan: SegmentedScan,
    models: Mapping[str, SmplicitModel],
    found: FittedScan,
    draped: Mapping[str, DrapedSheet],
    settings: FitScan,
    seed: int,
) -> dict[str, np.ndarray]:
    """Codes of garments that hang on the body, fitted once more; the others' as they are.

    Points near a sheet follow it from the pose back to rest, and not the body alone: skinned cloth
    neither hangs nor folds, and codes that are fitted with it make up for that.

    Args:
        scan, models, settings, seed: as of `fit_scan`.
        found: codes and body.
        draped: garment -> its sheet as it hangs on that body.
    """
    moved, terms = _terms(scan, models, [*draped], found.body, settings, seed)
    state = found.body
    posed = pose_body(moved.model, state.shape, state.pose, state.trans)
    codes = dict(found.codes)
    for name, part in terms.items():
        around = add_cloth(posed, draped[name].rest.vertices, draped[name].posed.vertices)
        places = move_to_rest(part.points.places, around, settings.neighbours).places
        codes[name] = part.code(part.fit(places, state.shape, part.whiten(codes[name])))
    return codes


def _terms(
    scan: SegmentedScan,
    models: Mapping[str, SmplicitModel],
    names: Sequence[str],
    body: BodyState,
    settings: FitScan,
    seed: int,
) -> tuple[MovedBody, dict[str, GarmentTerms]]:
    """The body, and what a scan says about each of some garments on it."""
    model = models[MODEL_OF_GARMENT[names[0]]].bodies[scan.gender]
    moved = MovedBody(model, body)
    normals = vertex_normals(moved.vertices, model.faces)
    terms = {
        name: GarmentTerms(
            models[MODEL_OF_GARMENT[name]],
            name,
            field_points(
                scan,
                name,
                (moved.vertices, normals),
                rng_for(seed, "scan points", scan.name, name),
                cloth=settings.cloth,
                around=settings.around,
                spread_m=settings.spread_m,
                uncovered_weight=settings.uncovered_weight,
            ),
            scan.gender,
            settings,
        )
        for name in names
    }
    return moved, terms


def _fit_jointly(
    body_terms: BodyTerms,
    terms: Mapping[str, GarmentTerms],
    codes: Mapping[str, np.ndarray],
    body: MovedBody,
    settings: FitScan,
) -> tuple[dict[str, np.ndarray], BodyState]:
    ends = UNKNOWNS + np.cumsum([0, *(part.numbers for part in terms.values())])
    places = {
        name: slice(start, stop)
        for name, start, stop in zip(terms, ends[:-1], ends[1:], strict=True)
    }
    rest_by_shape = shape_basis(body.model)[1:]
    codes = dict(codes)
    for _ in range(settings.joint_steps):
        equations = LeastSquares(int(ends[-1]))
        body_terms.add_to(equations, body)
        for name, part in terms.items():
            at_rest = PointsAtRest(part.points.places, body, settings.neighbours)
            field = part.evaluate_field(at_rest.places, body.state.shape, codes[name])
            by_body = at_rest.slopes(field.by_place, rest_by_shape)
            by_body[:, SHAPE] += field.by_shape
            slopes = np.concatenate([by_body, field.by_code], axis=1)
            weights = part.weights(field.residual)
            equations.add(slopes, field.residual, weights, slice(0, UNKNOWNS), places[name])
            equations.add_prior(places[name], codes[name], 1.0)
        change = equations.step(_DAMPING)
        codes = {name: w + change[places[name]] for name, w in codes.items()}
        body = MovedBody(body.model, body.state.step(change[:UNKNOWNS]))
    return codes, body.state
