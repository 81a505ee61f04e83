"""Trainings of the paper's stages and of their baselines, and the folders that they leave.

The canonical stage is trained first, or PN++ in its place; the posed stage, or MGN*, is trained on
the levels of points and the canonical garments of a finished one.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np
import torch

from drapeline.bodies.model import BodyModel, keep_body, load_kept_body
from drapeline.dataset.windows import window_starts
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.learning_data.sequences import SequenceData
from drapeline.models.garment4d.canonical import (
    CanonicalNetwork,
    CanonicalOutput,
    PointNetRegressor,
)
from drapeline.models.garment4d.data import (
    BodySequences,
    BodySet,
    DressedSequences,
    Windows,
)
from drapeline.models.garment4d.losses import (
    CotangentLaplacian,
    UniformLaplacian,
    balance_labels,
    canonical_loss,
    posed_loss,
)
from drapeline.models.garment4d.posed import MgnNetwork, PosedNetwork
from drapeline.models.garment4d.settings import (
    CanonicalStageSettings,
    MgnStageSettings,
    PosedStageSettings,
    StageSettings,
)
from drapeline.models.layers.point_search import SEARCH_ANEW, Searches, SearchMemory
from drapeline.models.layers.pointnet import PointLevel
from drapeline.models.training.batches import Batch, ByteCache
from drapeline.models.training.checkpoints import (
    building,
    load_state,
    read_checkpoint,
    tensors_digest,
)
from drapeline.models.training.module import BEST, TrainableModule
from drapeline.npy import check_arrays
from drapeline.outfits.garment_types import LABELS
from drapeline.registration.to_template.garment_space import GarmentSpace
from drapeline.seeding import rng_for
from drapeline.storage import forms_of, load_npz, save_npz

_BATCH = 4  # windows at once where no gradient is wanted
_KEPT_BYTES = 1 << 30  # of the answers to searches in windows, and of their levels, each
_SIZES, _BODIES = "reconstruction.npz", "bodies"


class Stage(TrainableModule):
    """A network of Garment4D in training on windows of sequences.

    Args:
        settings: of the subclass's `SETTINGS`.

    Attributes:
        checkpoint_type: name of the class in checkpoints; also seeds the initial weights.
        ERROR: name of the error that is logged beside the loss.
    """

    checkpoint_type: ClassVar[str]
    SETTINGS: ClassVar[type[StageSettings]]
    ERROR: ClassVar[str]
    settings: StageSettings

    def __init__(self, settings: StageSettings) -> None:
        super().__init__()
        self.settings = settings

    @classmethod
    @abstractmethod
    def from_metadata(cls, metadata: Mapping[str, Any]) -> Self:
        """An untrained one, from what `checkpoint_metadata` gave."""

    def weight_rng(self) -> torch.Generator:
        """For the initial weights."""
        rng = rng_for(self.settings.training.seed, self.checkpoint_type, "weights")
        return torch.Generator().manual_seed(int(rng.integers(2**62)))

    @abstractmethod
    def losses(self, batch: Batch) -> tuple[dict[str, torch.Tensor], torch.Tensor]:
        """Named terms with their `total`, and `ERROR`, a scalar."""

    def training_step(self, batch: Batch) -> torch.Tensor:
        """Loss of a batch."""
        terms, error = self.losses(batch)
        loss = terms["total"]
        self.stop_if_unfinite(loss, terms, batch["names"])
        self.log_means("train", {**terms, self.ERROR: error}, len(batch["names"]))
        return loss

    def validation_step(self, batch: Batch) -> None:
        """The same on validation windows; the best weights are those of the least total."""
        terms, error = self.losses(batch)
        self.log_means("val", {**terms, self.ERROR: error}, len(batch["names"]))

    def checkpoint_metadata(self) -> dict[str, Any]:
        """All that is needed to build the module again, as plain values and tensors."""
        return {"checkpoint_type": self.checkpoint_type, "settings": self.settings.plain()}


class GarmentStage(Stage):
    """A stage that is trained for a garment type.

    Args:
        settings: of the subclass's `SETTINGS`.
        label: the type's index in `LABELS`.

    Attributes:
        garment: the type.
        MOST_VALIDATED: validation windows of each sequence at most, see `Windows`.
    """

    MOST_VALIDATED: ClassVar[int | None] = None
    laplacian: CotangentLaplacian | UniformLaplacian

    def __init__(self, settings: StageSettings, space: GarmentSpace, label: int) -> None:
        super().__init__(settings)
        self.space, self.label, self.garment = space, label, LABELS[label]
        self.laplacian = CotangentLaplacian(space.mean, space.faces)

    def dependencies(self) -> dict[str, Any]:
        """JSON values that the result depends on besides settings and data."""
        return {}

    def training_sequences(self, sequences: BodySequences) -> BodySequences:
        """Those sequences with all that batches of this stage hold."""
        return sequences

    def prepare(self, windows: Windows) -> None:
        """Take from the training windows what is not learned in steps."""

    def checkpoint_metadata(self) -> dict[str, Any]:
        """With the type and its space."""
        return {
            **super().checkpoint_metadata(),
            "space": {key: torch.from_numpy(value) for key, value in vars(self.space).items()},
            "label": self.label,
        }


def space_of(metadata: Mapping[str, Any]) -> GarmentSpace:
    """The garment space of what `checkpoint_metadata` gave.

    Raises:
        InputError: an array is missing or of another form.
    """
    arrays = {key: value.numpy() for key, value in metadata["space"].items()}
    check_arrays(arrays, forms_of(GarmentSpace))
    return GarmentSpace(**arrays)


def window_keys(batch: Batch) -> list[tuple[int, int]]:
    """Sequence and first frame of each window of a batch."""
    return list(zip(batch["sequence"].tolist(), batch["start"].tolist(), strict=True))


def distance_mm(predicted: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """Mean distance in mm of vertices (..., 3) in metres."""
    return 1000 * (predicted.detach() - true).norm(dim=-1).mean()


class CanonicalStage(GarmentStage):
    """Canonical garment estimation, with the loss of equation 4."""

    checkpoint_type = "garment4d_canonical"
    SETTINGS, ERROR = CanonicalStageSettings, "canonical_error_mm"
    MOST_VALIDATED = 3
    network: Any  # what `build` makes
    laplacian: CotangentLaplacian
    label_weights: torch.Tensor

    def __init__(self, settings: CanonicalStageSettings, space: GarmentSpace, label: int) -> None:
        super().__init__(settings, space, label)
        self.network = self.build()
        self.register_buffer("label_weights", torch.ones(len(LABELS)))
        self._memory = SearchMemory(_KEPT_BYTES)

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, Any]) -> Self:
        """An untrained one, from what `checkpoint_metadata` gave."""
        settings = CanonicalStageSettings(**metadata["settings"])
        return cls(settings, space_of(metadata), metadata["label"])

    def build(self) -> torch.nn.Module:
        """The network that is trained."""
        network, rng = self.settings.network, self.weight_rng()
        return CanonicalNetwork(network, self.space, self.label, rng)

    def untrained(self) -> Self:
        """The same stage with the weights that its training began with."""
        stage = deepcopy(self)
        stage.network = self.build().to(self.device)
        return stage.eval()

    def prepare(self, windows: Windows) -> None:
        """Balance labels by their share of the training points."""
        share = windows.sequences.data.label_share("train")
        self.label_weights.copy_(balance_labels(share, self.settings.loss.balance))

    def losses(self, batch: Batch) -> tuple[dict[str, torch.Tensor], torch.Tensor]:
        """Equation 4, and the mean distance of canonical vertices."""
        output = self.estimate(batch)
        terms = canonical_loss(
            output,
            batch["labels"],
            batch["coefficients"],
            batch["canonical"],
            batch["rest_body"],
            batch["rest_normals"],
            self.laplacian,
            self.settings.loss,
            self.label_weights,
        )
        return terms, distance_mm(output.vertices, batch["canonical"])

    def estimate(self, batch: Batch) -> CanonicalOutput:
        """Garments of a batch.

        In training the points that truly are the garment's are used: with those of a segmentation
        that has learned nothing yet, alpha would learn nothing either.
        """
        if not self.training:
            return self.network(batch["points"])
        return self.network(batch["points"], batch["labels"], self.searches(batch))

    def searches(self, batch: Batch) -> Searches:
        """Remembered in training: points and their true labels are the same in every epoch."""
        return self._memory.of(window_keys(batch)) if self.training else SEARCH_ANEW


class PointNetStage(CanonicalStage):
    """The PN++ baseline of table 2: coefficients from all points, without segmentation."""

    checkpoint_type = "garment4d_pointnet"

    def build(self) -> torch.nn.Module:
        """The network that is trained."""
        return PointNetRegressor(self.settings.network, self.space, self.weight_rng())

    def estimate(self, batch: Batch) -> CanonicalOutput:
        """Garments of a batch."""
        return self.network(batch["points"], self.searches(batch))


class PosedStage(GarmentStage):
    """Posed garment reconstruction from proposals, with the loss of equation 7.

    The trained canonical stage of the same type is frozen and gives levels of points.
    """

    checkpoint_type = "garment4d_posed"
    SETTINGS: ClassVar[type[StageSettings]] = PosedStageSettings
    ERROR = "vertex_error_mm"
    settings: Any  # of `SETTINGS`

    def __init__(
        self, settings: PosedStageSettings | MgnStageSettings, canonical: CanonicalStage
    ) -> None:
        super().__init__(settings, canonical.space, canonical.label)
        if settings.loss.laplacian_form == "released":
            self.laplacian = UniformLaplacian(self.space.faces, len(self.space.mean))
        self.canonical = canonical.requires_grad_(False)
        self.network = self.build(canonical.network)
        self._levels: ByteCache[tuple[int, int], list[PointLevel]] = ByteCache(_KEPT_BYTES)

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, Any]) -> Self:
        """An untrained one, from what `checkpoint_metadata` gave."""
        settings: Any = cls.SETTINGS(**metadata["settings"])
        return cls(settings, CanonicalStage.from_metadata(metadata["canonical"]))

    @property
    def smooth_passes(self) -> int:
        """Over the frames of a whole sequence, see `PosedSettings`."""
        return self.settings.network.smooth_passes

    def build(self, canonical: CanonicalNetwork) -> torch.nn.Module:
        """The network that is trained."""
        return PosedNetwork(
            self.settings.network,
            self.space.faces,
            len(self.space.mean),
            canonical.level_channels,
            self.weight_rng(),
        )

    def untrained(self) -> "PosedStage":
        """The same stage with the weights that its training began with."""
        stage = deepcopy(self)
        stage.network = self.build(self.canonical.network).to(self.device)
        return stage.eval()

    def estimate_canonical(self, points: torch.Tensor) -> CanonicalOutput:
        """Output of the canonical network for windows (B, T, P, 3), without gradient."""
        with torch.no_grad():
            return self.canonical.network(points)

    def point_levels(self, batch: Batch) -> list[PointLevel]:
        """Levels of points of a batch from the canonical network, or from memory.

        The network is frozen, so that a window's levels are the same whenever it comes.
        """
        keys = window_keys(batch)
        new = [row for row, key in enumerate(keys) if key not in self._levels]
        levels = {key: self._levels[key] for key in keys if key in self._levels}
        if new:
            output = self.estimate_canonical(batch["points"][new])
            levels |= self._keep([keys[row] for row in new], output.levels)
        by_level = zip(*(levels[key] for key in keys), strict=True)
        # Some were computed before the network was moved to where it is trained.
        device = batch["points"].device
        return [
            PointLevel(*(torch.cat([x.to(device) for x in xs]) for xs in zip(*level, strict=True)))
            for level in by_level
        ]

    def _keep(
        self, keys: Sequence[tuple[int, int]], levels: Sequence[PointLevel]
    ) -> dict[tuple[int, int], list[PointLevel]]:
        """Levels of windows by sequence and first frame, which are kept while there is room."""
        frames = len(levels[0].points) // len(keys)
        parts = [slice(row * frames, (row + 1) * frames) for row in range(len(keys))]
        of_window = {
            key: [PointLevel(*(x[clouds] for x in level)) for level in levels]
            for key, clouds in zip(keys, parts, strict=True)
        }
        for key, part in of_window.items():
            self._levels.add(key, part)
        return of_window

    def training_sequences(self, sequences: BodySequences) -> DressedSequences:
        """Sequences in the canonical garments that the canonical network predicts for them.

        Bodies of the test split wear the mean garment.
        """
        canonical = self.predict_canonicals(sequences.data, ("train", "val"))
        return DressedSequences(sequences, canonical, self.settings.skinning)

    def predict_canonicals(self, data: SequenceData, splits: Sequence[str]) -> np.ndarray:
        """T(alpha') of the sequences of some splits, (S, N, 3) float32; others get the mean.

        Alpha' is the mean over a sequence's windows. Levels of points are kept for training, whose
        windows are the same unless they overlap.
        """
        frames = self.settings.training.frames
        alpha = np.zeros_like(data.coefficients, dtype=np.float32)
        for sequence in np.flatnonzero(np.isin(data.split, splits)).tolist():
            points = data.points[data.rows(sequence)]
            starts = window_starts(len(points), frames, frames, str(data.name[sequence]))
            coefficients = []
            for part in np.array_split(starts, -(-len(starts) // _BATCH)):
                windows = np.stack([points[start : start + frames] for start in part])
                clouds = torch.from_numpy(windows).to(self.canonical.device)
                output = self.estimate_canonical(clouds)
                self._keep([(sequence, start) for start in part.tolist()], output.levels)
                coefficients.append(output.coefficients)
            alpha[sequence] = torch.cat(coefficients).mean(0).cpu().numpy()
        return data.space.vertices(alpha)

    def predict(self, batch: Batch, levels: list[PointLevel]) -> list[torch.Tensor]:
        """Posed garments (B, T, N, 3) in metres after each iteration, the last one the best."""
        return self.network(batch["proposal"], levels, batch["body"], batch["body_normals"])

    def losses(self, batch: Batch) -> tuple[dict[str, torch.Tensor], torch.Tensor]:
        """Equation 7, and the mean distance of posed vertices."""
        predictions = self.predict(batch, self.point_levels(batch))
        terms = posed_loss(
            predictions,
            batch["target"],
            batch["body"],
            batch["body_normals"],
            self.laplacian,
            self.settings.loss,
        )
        return terms, distance_mm(predictions[-1], batch["target"])

    def dependencies(self) -> dict[str, Any]:
        """The canonical network."""
        return {
            "canonical": self.canonical.settings.plain(),
            "canonical_weights": tensors_digest(self.canonical.state_dict()),
        }

    def checkpoint_metadata(self) -> dict[str, Any]:
        """With what the canonical network is built from."""
        return {**super().checkpoint_metadata(), "canonical": self.canonical.checkpoint_metadata()}


class MgnStage(PosedStage):
    """The MGN* baseline of table 3: displacements of the canonical garment, then K = 1 skinning."""

    checkpoint_type = "garment4d_mgn"
    SETTINGS = MgnStageSettings

    def build(self, canonical: CanonicalNetwork) -> torch.nn.Module:
        """The network that is trained."""
        return MgnNetwork(
            self.settings.network,
            self.space.faces,
            len(self.space.mean),
            canonical.level_channels,
            self.weight_rng(),
        )

    def predict(self, batch: Batch, levels: list[PointLevel]) -> list[torch.Tensor]:
        """Posed garments (B, T, N, 3) in metres."""
        return [self.network(batch["worn"], levels, batch["weights"], batch["transforms"])]


Loaded = TypeVar("Loaded", bound=Stage)


def load_stage(folder: str | Path, *expected: type[Loaded]) -> Loaded:
    """A trained stage from the folder that its training left, ready to predict.

    Args:
        expected: the stages that it may hold.

    Raises:
        InputError: the checkpoint is missing, damaged, or of another stage.
    """
    path = Path(folder) / BEST
    checkpoint = read_checkpoint(path)
    found = checkpoint.metadata["checkpoint_type"]
    stages = {cls.checkpoint_type: cls for cls in expected}
    if found not in stages:
        raise InputError(f"{path}: holds a '{found}' network, expected {' or '.join(stages)}")
    with building(path):
        stage = stages[found].from_metadata(checkpoint.metadata)
    load_state(stage, checkpoint, path)
    return stage.eval()


class SeenForms(NamedTuple):
    """What scans are brought to before a model is given them."""

    bodies: BodySet  # of both genders
    points: int  # P, number per cloud that it was trained on


def save_seen_forms(folder: Path, sequences: BodySequences) -> None:
    """Complete the folder of a model that was trained on sequences."""
    bodies = sequences.bodies
    keep_bodies(folder, bodies.models)
    points = sequences.data.points.shape[1]
    save_npz(folder / _SIZES, body_points=bodies.count, points=points)


def load_seen_forms(folder: str | Path) -> SeenForms:
    """Read what `save_seen_forms` wrote beside a trained model.

    Raises:
        InputError: a file is missing or damaged.
    """
    folder = Path(folder)
    found = load_npz(folder / _SIZES, {"body_points": "int", "points": "int"})
    for name in ("body_points", "points"):
        if found[name] < 1:
            raise InputError(
                f"{folder / _SIZES}: '{name}' is {int(found[name])}, expected at least 1"
            )
    bodies = BodySet(load_kept_bodies(folder), int(found["body_points"]))
    return SeenForms(bodies, int(found["points"]))


def keep_bodies(folder: Path, bodies: Mapping[str, BodyModel]) -> None:
    """Add bodies by gender to the folder of a model."""
    for gender, body in bodies.items():
        keep_body(folder / _BODIES / f"{gender}.npz", body, gender)


def load_kept_bodies(folder: str | Path) -> dict[str, BodyModel]:
    """Bodies by gender that `keep_bodies` added.

    Raises:
        InputError: a file is missing or damaged.
    """
    root = Path(folder) / _BODIES
    return {gender: load_kept_body(root / f"{gender}.npz", gender) for gender in GENDERS}
