"""Representations of garments, codes fitted to scans, and movers, for the comparison of models."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import torch
from scipy.spatial import KDTree
from torch.nn import functional

from drapeline.bodies.follow import move_to_rest, pose_body
from drapeline.bodies.model import BodyModel
from drapeline.bodies.moved_body import BodyState
from drapeline.bodies.sequence import untouched_sequence
from drapeline.dataset.segmented_scans import SegmentedScan
from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.learning_data.dynamic import HISTORY_FRAMES, HISTORY_STEP, DynamicData
from drapeline.learning_data.static import StaticData
from drapeline.metrics.baselines import GarmentPca
from drapeline.metrics.garment import garment_mesh
from drapeline.models.contract import HeldOutGarment, MovingPerson, Stopwatch
from drapeline.models.gcvae.codec import GarmentCodec, decode_codes, encode_garments
from drapeline.models.gcvae.data import BodyTemplate
from drapeline.models.gcvae.decode import static_truth
from drapeline.models.gcvae.movers import WornSheet, move_by_model
from drapeline.models.gcvae.sample import Request
from drapeline.models.training.optimise import CosineAdam
from drapeline.outfits.garment_types import GARMENTS, LABELS
from drapeline.outfits.worn import SkinningOptions, pose_in_layers
from drapeline.registration.to_body.topology import topology_codes
from drapeline.registration.to_scan import move_to_scan


class RegisteredOffsets:
    """No code: offsets and mask as registered, on the template's rest bodies."""

    variant = "body_registered"

    def __init__(self, data: StaticData, template: BodyTemplate) -> None:
        self.data, self._truth = data, static_truth(template, data)

    def code_numbers(self, garment: str) -> int | None:
        """None: there is no code."""

    def rebuild(self, garments: Sequence[HeldOutGarment]) -> Iterator[Mesh]:
        """Body plus offsets, within the mask."""
        predictions = self.predict(np.array([garment.row for garment in garments]))
        for garment, (offsets, mask) in zip(garments, predictions, strict=True):
            body, faces = self._truth.body(garment.row), self._truth.faces(garment.row)
            yield garment_mesh(body + offsets, faces, mask)

    def predict(self, rows: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Offsets and mask of rows."""
        return ((self.data.offsets[row], self.data.mask[row]) for row in rows)


class OffsetPca(RegisteredOffsets):
    """Components of the training offsets, and the mask regressed on them."""

    def __init__(
        self, variant: str, pca: GarmentPca, data: StaticData, template: BodyTemplate
    ) -> None:
        super().__init__(data, template)
        self.variant, self._pca = variant, pca

    def code_numbers(self, garment: str) -> int:
        """The number of components."""
        return len(self._pca.axes)

    def predict(self, rows: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Offsets and mask of rows from their components."""
        return (self._pca.reconstruct(self.data.offsets[row]) for row in rows)


class GuessedOffsets(RegisteredOffsets):
    """A baseline that does not see the garment."""

    def __init__(
        self,
        variant: str,
        guess: Callable[[int], tuple[np.ndarray, np.ndarray]],
        data: StaticData,
        template: BodyTemplate,
    ) -> None:
        super().__init__(data, template)
        self.variant, self._guess = variant, guess

    def predict(self, rows: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Offsets and mask of rows as guessed."""
        return map(self._guess, rows.tolist())


class VaeCode(RegisteredOffsets):
    """The posterior mean of a trained static VAE with a mask branch."""

    def __init__(self, variant: str, model: GarmentCodec, data: StaticData) -> None:
        super().__init__(data, model.body_template)
        self.variant, self._model = variant, model

    def code_numbers(self, garment: str) -> int:
        """The size of z."""
        return self._model.latent

    def predict(self, rows: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Offsets and mask of rows, encoded and decoded."""
        z = encode_garments(self._model, self.data, rows).mean
        return decode_codes(self._model, z, self.data.cvar(rows), self.data.topology(rows))


@dataclass(frozen=True)
class FitCode:
    """Settings of a fit of codes to a registration."""

    steps: int = 40  # of Adam
    rate: float = 0.1  # its first learning rate, which falls to zero
    # Weight of the mask's cross entropy beside offsets in units of their deviation.
    mask: float = 0.5
    prior: float = 0.01  # weight of the mean square of the code
    # How garments follow the body.
    skinning: SkinningOptions = field(default_factory=SkinningOptions)


class RegisteredPoints(NamedTuple):
    """The points of a garment as a registration to the body."""

    offsets: np.ndarray  # (V, 3) metres, to the garment's nearest point
    mask: np.ndarray  # (V,) whether the garment covers the vertex
    known: np.ndarray  # (V,) whether the scan tells


class CodeScanFitter:
    """Fulfils `ScanFitter` with trained static models that have a mask, by variant."""

    def __init__(
        self, models: Mapping[str, GarmentCodec], bodies: Mapping[str, BodyModel], settings: FitCode
    ) -> None:
        self.watch = Stopwatch()
        self._models, self._bodies, self._settings = models, bodies, settings

    def fit(self, scan: SegmentedScan, body: BodyState) -> dict[str, dict[str, Mesh]]:
        """All garments of the scan, by each model, also moved to the points."""
        with self.watch.of(*(f"{name}{end}" for name in self._models for end in ("", "_moved"))):
            posed = pose_body(self._bodies[scan.gender], body.shape, body.pose, body.trans)
            rest_points = move_to_rest(scan.points, posed, 1).places
        fits = {}
        for variant, model in self._models.items():
            garments, moved = {}, f"{variant}_moved"
            with self.watch.of(variant, moved):
                for name in scan.garments:
                    request = Request(name, scan.gender, body.shape, np.zeros(2))
                    rest = model.body_template.rest_body(request.cvar)
                    registered = register_points(rest, rest_points, scan, name)
                    garments[name] = self._decode(model, request, rest, registered)
                fits[variant] = pose_in_layers(garments, posed, self._settings.skinning)
            with self.watch.of(moved):
                fits[moved] = move_to_scan(fits[variant], garments, scan, posed)
        return fits

    def _decode(
        self, model: GarmentCodec, request: Request, rest: np.ndarray, registered: RegisteredPoints
    ) -> Mesh:
        topology = topology_codes(np.array([GARMENTS.index(request.garment)]))
        z = fit_code(model, request.cvar[None], topology, registered, self._settings)
        ((offsets, mask),) = decode_codes(model, z, request.cvar[None], topology)
        return garment_mesh(rest + offsets, model.body_template.faces_of(request.garment), mask)


def register_points(
    body: np.ndarray, points: np.ndarray, scan: SegmentedScan, garment: str
) -> RegisteredPoints:
    """The registration of a garment's points.

    Args:
        body: (V, 3) at rest.
        points: (P, 3) of the scan, moved back to rest.
        scan: with their labels.
    """
    own = points[scan.labels == LABELS.index(garment)]
    over = scan.garments[scan.garments.index(garment) + 1 :]
    _, nearest = KDTree(points).query(body)
    labels = scan.labels[nearest]
    _, place = KDTree(own).query(body)
    return RegisteredPoints(
        (own[place] - body).astype(np.float32),
        labels == LABELS.index(garment),
        ~np.isin(labels, [LABELS.index(name) for name in over]),
    )


def fit_code(
    model: GarmentCodec,
    cvar: np.ndarray,
    topology: np.ndarray,
    registered: RegisteredPoints,
    settings: FitCode,
) -> np.ndarray:
    """(1, Z) float32 code of a registration, from the code that it is encoded to.

    Args:
        model: with a mask.
        cvar: (1, C) conditions.
        topology: (1,) code of `TOPOLOGIES`.
        registered: the garment.
    """
    offsets, mask, known = (torch.from_numpy(part) for part in registered)
    given = torch.from_numpy(cvar), torch.from_numpy(topology)
    batch = {"offsets": offsets[None], "mask": mask[None], "cvar": given[0], "topology": given[1]}
    covered, scale = mask & known, model.offset_std[int(topology[0])]

    def loss(z: torch.Tensor) -> torch.Tensor:
        decoded, probability = model.decode(z, *given)
        assert probability is not None
        away = ((decoded[0] - offsets) / scale)[covered].abs().mean()
        crossing = functional.binary_cross_entropy(
            probability[0][known].clamp(1e-4, 1 - 1e-4), mask[known].float()
        )
        return away + settings.mask * crossing + settings.prior * z.square().mean()

    adam = CosineAdam(model.encode(batch).mean, rate=settings.rate, steps=settings.steps)
    for _ in range(settings.steps):
        adam.step(loss)
    return adam.x.detach().numpy()


class LearnedMover:
    """Fulfils `Mover` with models of garments in motion.

    Args:
        models: by variant; see `movers.load_mover`.
        static: whose codes they were trained with.
        data: of all garments in motion, with their registrations at rest.
        bodies: by gender.
    """

    def __init__(
        self,
        models: Mapping[str, GarmentCodec],
        static: GarmentCodec,
        data: DynamicData,
        bodies: Mapping[str, BodyModel],
    ) -> None:
        self.watch = Stopwatch()
        self._models, self._static, self._data, self._bodies = models, static, data, bodies

    def move(self, person: MovingPerson) -> dict[str, dict[str, Mesh]]:
        """All garments, with the likeliest wrinkles, smoothed and pushed out of the body."""
        known = slice(-1 - HISTORY_STEP * (HISTORY_FRAMES - 1), None)
        record = untouched_sequence(
            person.shape, person.gender, person.poses[known], person.trans[known]
        )
        worn = {name: self._worn(person, name) for name in person.rest}
        body, moved = self._bodies[person.gender], {}
        for variant, model in self._models.items():
            with self.watch.of(variant):
                sheets = move_by_model(
                    model, self._static, worn, body, record, settle=True, frames=slice(-1, None)
                )
            moved[variant] = {name: sheet.frames[0] for name, sheet in sheets.items()}
        return moved

    def _worn(self, person: MovingPerson, name: str) -> WornSheet:
        """A garment with its registration."""
        data, rest = self._data, person.rest[name]
        same = (data.sample == person.sample) & (data.garment == GARMENTS.index(name))
        row = np.flatnonzero(same)
        if not len(row):
            raise InputError(f"no registration of {person.sample}'s {name}, expected one")
        (cvar,) = data.cvar(row[:1])
        return WornSheet(rest, rest, data.static[row[0]], data.mask[row[0]], cvar)
