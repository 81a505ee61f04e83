"""Stages of Garment4D as they are trained: canonical and posed, and a baseline of each."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch

from drapeline.dataset.point_clouds import LABELS
from drapeline.errors import InputError
from drapeline.models.garment4d.body_input import SkinningSettings
from drapeline.models.garment4d.canonical import (
    Abstraction,
    CanonicalNetwork,
    CanonicalOutput,
    CanonicalSettings,
    CanonicalWeights,
    PointNetRegressor,
    balanced,
    canonical_loss,
)
from drapeline.models.garment4d.data import SOURCES, SequenceData, Windows, window_starts
from drapeline.models.garment4d.losses import CotangentLaplacian, UniformLaplacian
from drapeline.models.garment4d.posed import (
    MgnNetwork,
    MgnSettings,
    PosedNetwork,
    PosedSettings,
    PosedWeights,
    posed_loss,
)
from drapeline.models.layers.point_search import Recall
from drapeline.models.layers.pointnet import PointLevel
from drapeline.models.training.batches import Batch, as_tensors
from drapeline.models.training.checkpoints import read_checkpoint
from drapeline.models.training.digests import tensors_digest
from drapeline.models.training.module import BEST, TrainableModule, Training, plain
from drapeline.registration.to_template.garment_space import GarmentSpace
from drapeline.rule_log import LOGGER
from drapeline.seeding import rng_for

_THINNED = (1, 2, 4)  # maps are fitted to every point, every second and every fourth one
_BATCH = 4  # windows at once where no gradient is wanted
_KEPT_BYTES = 1 << 30  # of what it said, or what was searched, about windows of training


@dataclass(frozen=True)
class Garment4dTraining(Training):
    """How a network of either stage is trained on windows; numbers of the released code.

    Its batch is that of the canonical stage; the posed stage has 4 there.

    Attributes:
        frames: T of a window.
        stride: frames from one training window to the next.
        sources: of the sequences, of `data.SOURCES`.
    """

    batch: int = 20
    frames: int = 10
    stride: int = 10
    sources: tuple[str, ...] = SOURCES


def settings_of(cls: type, values: Mapping[str, Any]) -> Any:
    """A settings dataclass from nested mappings and lists as they stand in a config or checkpoint.

    Raises:
        InputError: a name is none of the dataclass's.
    """
    known = [one.name for one in fields(cls)]
    unknown = [name for name in values if name not in known]
    if unknown:
        raise InputError(
            f"{cls.__name__}: no setting '{unknown[0]}', expected one of {', '.join(known)}"
        )
    return cls(**{name: _value(value) for name, value in values.items()})


def _value(value: Any) -> Any:
    """Lists as tuples; the only mappings within settings are abstractions."""
    if isinstance(value, Mapping):
        return settings_of(Abstraction, value)
    return tuple(map(_value, value)) if isinstance(value, list | tuple) else value


@dataclass(frozen=True)
class StageSettings:
    """All that a network of a stage is built from besides the garment space.

    Attributes:
        network: sizes.
        loss: weights.
        training: how long, on what.
        skinning: of proposals, which the posed stage alone has.
    """

    network: Any
    loss: Any
    training: Garment4dTraining = field(default_factory=Garment4dTraining)
    skinning: SkinningSettings = field(default_factory=SkinningSettings)


class Stage(TrainableModule):
    """What the trainings of both stages share.

    Args:
        settings: of the subclass's `NETWORK` and `LOSS`.
        space: of the garment type.
        label: the type's code in `LABELS`.
    """

    kind: ClassVar[str]
    NETWORK: ClassVar[type]
    LOSS: ClassVar[type]
    POSED: ClassVar[bool]
    ERROR: ClassVar[str]
    SKINNING: ClassVar[SkinningSettings] = SkinningSettings()

    def __init__(self, settings: StageSettings, space: GarmentSpace, label: int) -> None:
        super().__init__()
        self.settings, self.space, self.label = settings, space, label
        self.laplacian = CotangentLaplacian(space.mean, space.faces)

    @classmethod
    def settings_of(cls, values: Mapping[str, Mapping[str, Any]]) -> StageSettings:
        """From nested mappings as they stand in a config or a checkpoint."""
        return StageSettings(
            cls.network_of(values.get("network", {})),
            settings_of(cls.LOSS, values.get("loss", {})),
            settings_of(Garment4dTraining, values.get("training", {})),
            settings_of(SkinningSettings, {**asdict(cls.SKINNING), **values.get("skinning", {})}),
        )

    @classmethod
    def network_of(cls, values: Mapping[str, Any]) -> Any:
        """Sizes from a mapping."""
        return settings_of(cls.NETWORK, values)

    @property
    def body_relative_points(self) -> bool:
        """Whether points also say where on the body they are."""
        return self.settings.network.body_relative_points

    def weight_rng(self) -> torch.Generator:
        """For the initial weights."""
        rng = rng_for(self.settings.training.seed, self.kind, "weights")
        return torch.Generator().manual_seed(int(rng.integers(2**62)))

    # ---- what kinds of stages do differently

    @abstractmethod
    def losses(self, batch: Batch) -> tuple[dict[str, torch.Tensor], torch.Tensor]:
        """Named terms with their `total`, and the error of the kind in mm, a scalar."""

    def given(self) -> dict[str, Any]:
        """What else the result depends on besides settings and data, as JSON values."""
        return {}

    def prepare(self, windows: Windows) -> None:
        """Take from the training windows what is not learned in steps."""

    # ---- training

    def training_step(self, batch: Batch) -> torch.Tensor:
        """Loss of one batch."""
        terms, error = self.losses(batch)
        loss = terms["total"]
        self.stop_if_unfinite(loss, terms, batch["names"])
        self.log_means("train", {**terms, self.ERROR: error}, len(batch["names"]))
        return loss

    def validation_step(self, batch: Batch) -> None:
        """The same on validation windows; the best weights are those of the least total."""
        terms, error = self.losses(batch)
        self.log_means("val", {**terms, self.ERROR: error}, len(batch["names"]))

    def about(self) -> dict[str, Any]:
        """All that is needed to build the module again, as plain values and tensors."""
        return {
            "kind": self.kind,
            "settings": plain(asdict(self.settings)),
            "space": {key: torch.from_numpy(value) for key, value in vars(self.space).items()},
            "label": self.label,
        }


class CanonicalStage(Stage):
    """Canonical garment estimation, with the loss of equation 4."""

    kind = "garment4d_canonical"
    NETWORK, LOSS, POSED, ERROR = CanonicalSettings, CanonicalWeights, False, "canonical_error_mm"

    @classmethod
    def network_of(cls, values: Mapping[str, Any]) -> CanonicalSettings:
        """Sizes; with `points` and `width` those that are not given are scaled, see there."""
        scale = {key: values[key] for key in ("points", "width") if key in values}
        given = {key: value for key, value in values.items() if value is not None}
        sizes = settings_of(
            CanonicalSettings, {key: value for key, value in given.items() if key not in scale}
        )
        if not scale:
            return sizes
        scaled = sizes.scaled(**scale)
        return replace(scaled, garment_points=given.get("garment_points", scaled.garment_points))

    def __init__(self, settings: StageSettings, space: GarmentSpace, label: int) -> None:
        super().__init__(settings, space, label)
        self.network = self.build()
        self.register_buffer("label_weights", torch.ones(len(LABELS)))
        self._recall = Recall(_KEPT_BYTES)
        self.out_of_fold_alpha: dict[str, torch.Tensor] = {}

    def build(self) -> torch.nn.Module:
        """The network that is trained."""
        network, rng = self.settings.network, self.weight_rng()
        return CanonicalNetwork(network, self.space, self.label, rng)

    def prepare(self, windows: Windows) -> None:
        """Balance labels by their share of the training points, and fit alpha to maps.

        `out_of_fold_alpha` is then the estimate for each training sequence from a fit without it:
        networks learn from estimates that are as wrong as those of new garments will be.
        """
        share = windows.data.label_share("train")
        self.label_weights.copy_(balanced(share, self.settings.loss.balance))
        network = self.network
        if network.regression is None:
            return
        names, maps, coefficients, whole = [], [], [], []
        rows = windows.rows("train")
        for part in np.array_split(rows, -(-len(rows) // _BATCH)):
            batch = as_tensors(windows.batch(part))
            points, chosen = batch["points"], network.chosen(batch["labels"])
            for step in _THINNED:
                names += sequences_of(batch)
                whole += [step == 1] * len(part)
                maps.append(network.maps(points[:, :, ::step], chosen[:, :, ::step]))
                coefficients.append(batch["coefficients"])
        if len(set(names)) < 2:
            LOGGER.warning("one training sequence: alpha does not begin with maps of the body")
            return
        components = self.space.components.reshape(len(self.space.components), -1)
        found, error = network.regression.fit(
            torch.cat(maps).numpy(),
            torch.cat(coefficients).numpy(),
            names,
            components @ components.T / len(self.space.mean),
        )
        LOGGER.info("maps of the body: off by %.1f mm for sequences left out", 1000 * error)
        of_sequence = np.where(whole, names, "")
        self.out_of_fold_alpha = {
            name: torch.from_numpy(found[of_sequence == name].mean(axis=0))
            for name in dict.fromkeys(names)
        }

    def initial_alpha(self, names: Sequence[str]) -> torch.Tensor | None:
        """(B, D) alpha that training sequences begin with; None if no maps were fitted."""
        if not self.out_of_fold_alpha:
            return None
        return torch.stack([self.out_of_fold_alpha[name] for name in names]).to(self.device)

    def losses(self, batch: Batch) -> tuple[dict[str, torch.Tensor], torch.Tensor]:
        """Equation 4, and the mean distance of canonical vertices."""
        # Neither the points nor their true labels are others in the next epoch.
        with self._recall.of(windows_of(batch)) if self.training else nullcontext():
            output = self.estimated(batch)
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

    def estimated(self, batch: Batch) -> CanonicalOutput:
        """Of a batch; in training alpha is made from the points that truly are the garment's.

        It would learn nothing before the segmentation has.
        """
        if not self.training:
            return self.network(batch["points"])
        initial_alpha = self.initial_alpha(sequences_of(batch))
        return self.network(batch["points"], batch["labels"], initial_alpha)

    def about(self) -> dict[str, Any]:
        """With `out_of_fold_alpha`, which the posed stage is trained on."""
        return {**super().about(), "out_of_fold_alpha": self.out_of_fold_alpha}


class PointNetStage(CanonicalStage):
    """The PN++ baseline of table 2: coefficients from all points, without segmentation."""

    kind = "garment4d_pointnet"

    def build(self) -> torch.nn.Module:
        """The network that is trained."""
        return PointNetRegressor(self.settings.network, self.space, self.weight_rng())

    def estimated(self, batch: Batch) -> CanonicalOutput:
        """Of a batch."""
        initial_alpha = self.initial_alpha(sequences_of(batch)) if self.training else None
        return self.network(batch["points"], initial_alpha)


def windows_of(batch: Batch) -> list[tuple[int, int]]:
    """Sequence and first frame of each window of a batch."""
    return list(zip(batch["sequence"].tolist(), batch["start"].tolist(), strict=True))


def sequences_of(batch: Batch) -> list[str]:
    """Name of the sequence that each window of a batch is of."""
    return [name.rpartition("/")[0] for name in batch["names"]]


class PosedStage(Stage):
    """Posed garment reconstruction from proposals, with the loss of equation 7.

    Args:
        settings: of the stage.
        canonical: trained, of the same garment type; it is frozen and gives levels of points.
    """

    kind = "garment4d_posed"
    NETWORK, LOSS, POSED, ERROR = PosedSettings, PosedWeights, True, "vertex_error_mm"

    def __init__(self, settings: StageSettings, canonical: CanonicalStage) -> None:
        super().__init__(settings, canonical.space, canonical.label)
        if settings.loss.laplacian_form == "released":
            self.laplacian = UniformLaplacian(self.space.faces, len(self.space.mean))
        self.canonical = canonical.requires_grad_(False)
        self.network = self.build(canonical.network)
        self._kept: dict[tuple[int, int], list[PointLevel]] = {}
        self._room = _KEPT_BYTES

    @property
    def body_relative_points(self) -> bool:
        """As the canonical stage has it."""
        return self.canonical.body_relative_points

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

    def levels(
        self,
        points: torch.Tensor,
        labels: torch.Tensor | None = None,
        initial_alpha: torch.Tensor | None = None,
    ) -> CanonicalOutput:
        """What the canonical network says about windows (B, T, P, 3), without gradient."""
        with torch.no_grad():
            return self.canonical.network(points, labels, initial_alpha)

    def kept_levels(self, batch: Batch) -> list[PointLevel]:
        """The same levels of points, of windows seen before from memory."""
        keys = windows_of(batch)
        new = [row for row, key in enumerate(keys) if key not in self._kept]
        found = {key: self._kept[key] for key in keys if key in self._kept}
        if new:
            levels = self.levels(batch["points"][new]).levels
            found |= self.keep([keys[row] for row in new], levels)
        windows = zip(*(found[key] for key in keys), strict=True)  # level by level
        # They were found before the network was moved to where it is trained.
        device = batch["points"].device
        return [
            PointLevel(*(torch.cat(x).to(device) for x in zip(*level, strict=True)))
            for level in windows
        ]

    def keep(
        self, keys: Sequence[tuple[int, int]], levels: Sequence[PointLevel]
    ) -> dict[tuple[int, int], list[PointLevel]]:
        """Levels of windows, by sequence and first frame; remembered while there is room."""
        frames = len(levels[0].points) // len(keys)
        parts = [slice(row * frames, (row + 1) * frames) for row in range(len(keys))]
        found = {
            key: [PointLevel(*(x[clouds] for x in level)) for level in levels]
            for key, clouds in zip(keys, parts, strict=True)
        }
        size = sum(x.nbytes for level in levels for x in level)
        if size <= self._room:
            self._kept |= found
            self._room -= size
        return found

    def predicted_canonicals(self, data: SequenceData, splits: Sequence[str]) -> np.ndarray:
        """T(alpha') of the sequences of some splits, (S, N, 3) float32; others have the mean.

        Alpha' is the mean over a sequence's windows; that of a training sequence begins with what
        maps say when it is left out of their fit. What the canonical network says of points is kept
        for training, whose windows are the same unless they overlap.
        """
        frames = self.settings.training.frames
        alpha = np.zeros_like(data.coefficients, dtype=np.float32)
        for sequence in np.flatnonzero(np.isin(data.split, splits)).tolist():
            points = data.clouds(sequence, body_relative_points=self.body_relative_points)
            name = str(data.name[sequence])
            starts = window_starts(len(points), frames, frames, name)
            found = []
            for part in np.array_split(starts, -(-len(starts) // _BATCH)):
                windows = np.stack([points[start : start + frames] for start in part])
                trained = name in self.canonical.out_of_fold_alpha
                initial_alpha = (
                    self.canonical.initial_alpha([name] * len(part)) if trained else None
                )
                given = torch.from_numpy(windows).to(self.canonical.device)
                output = self.levels(given, initial_alpha=initial_alpha)
                self.keep([(sequence, start) for start in part.tolist()], output.levels)
                found.append(output.coefficients)
            alpha[sequence] = torch.cat(found).mean(0).cpu().numpy()
        return data.space.vertices(alpha)

    def predictions(self, batch: Batch, levels: list[PointLevel]) -> list[torch.Tensor]:
        """Posed garments (B, T, N, 3) in metres, one for each iteration, the last one the best."""
        return self.network(batch["proposal"], levels, batch["body"], batch["body_normals"])

    def losses(self, batch: Batch) -> tuple[dict[str, torch.Tensor], torch.Tensor]:
        """Equation 7, and the mean distance of posed vertices."""
        found = self.predictions(batch, self.kept_levels(batch))
        terms = posed_loss(
            found,
            batch["target"],
            batch["body"],
            batch["body_normals"],
            self.laplacian,
            self.settings.loss,
        )
        return terms, distance_mm(found[-1], batch["target"])

    def given(self) -> dict[str, Any]:
        """The canonical network."""
        return {
            "canonical": plain(asdict(self.canonical.settings)),
            "canonical_weights": tensors_digest(self.canonical.state_dict()),
        }

    def about(self) -> dict[str, Any]:
        """With what the canonical network is built from."""
        return {**super().about(), "canonical": self.canonical.about()}


class MgnStage(PosedStage):
    """The MGN* baseline of table 3: displacements of the canonical garment, then K = 1 skinning."""

    kind = "garment4d_mgn"
    NETWORK, SKINNING = MgnSettings, SkinningSettings(neighbours=1, passes=0)
    smooth_passes = 0

    def build(self, canonical: CanonicalNetwork) -> torch.nn.Module:
        """The network that is trained."""
        return MgnNetwork(
            self.settings.network, len(self.space.mean), canonical.level_channels, self.weight_rng()
        )

    def predictions(self, batch: Batch, levels: list[PointLevel]) -> list[torch.Tensor]:
        """Posed garments (B, T, N, 3) in metres."""
        return [self.network(batch["worn"], levels, batch["weights"], batch["transforms"])]


_KINDS: dict[str, type[Stage]] = {
    cls.kind: cls for cls in (CanonicalStage, PointNetStage, PosedStage, MgnStage)
}


def load_stage(folder: str | Path, *kinds: type[Stage]) -> Any:
    """A trained stage from the folder that its training left, ready to predict.

    Args:
        folder: of the training.
        kinds: what it may be.

    Raises:
        InputError: the checkpoint is missing, damaged, or of another kind.
    """
    path = Path(folder) / BEST
    checkpoint = read_checkpoint(path)
    about = checkpoint["drapeline"]
    wanted = [cls.kind for cls in kinds]
    if about["kind"] not in wanted:
        raise InputError(
            f"{path}: holds a '{about['kind']}' network, expected {' or '.join(wanted)}"
        )
    stage = _built(about)
    stage.load_state_dict(checkpoint["state_dict"])
    return stage.eval()


def _built(about: Mapping[str, Any]) -> Stage:
    cls = _KINDS[about["kind"]]
    settings = cls.settings_of(about["settings"])
    if "canonical" in about:
        return cls(settings, _built(about["canonical"]))
    space = GarmentSpace(**{key: value.numpy() for key, value in about["space"].items()})
    stage = cls(settings, space, about["label"])
    stage.out_of_fold_alpha = about.get("out_of_fold_alpha", {})
    return stage


def distance_mm(predicted: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """Mean distance in mm of vertices (..., 3) in metres."""
    return 1000 * (predicted.detach() - true).norm(dim=-1).mean()
