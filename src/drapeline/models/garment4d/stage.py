"""What the trainings of both stages share: settings, losses that are logged, checkpoints."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, ClassVar

import torch

from drapeline.models.garment4d.body_input import SkinningSettings
from drapeline.models.garment4d.data import Windows
from drapeline.models.garment4d.losses import CotangentLaplacian
from drapeline.models.garment4d.settings import Garment4dTraining, StageSettings, settings_of
from drapeline.models.training.batches import Batch
from drapeline.models.training.module import TrainableModule, plain
from drapeline.registration.to_template.garment_space import GarmentSpace
from drapeline.seeding import rng_for


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


def windows_of(batch: Batch) -> list[tuple[int, int]]:
    """Sequence and first frame of each window of a batch."""
    return list(zip(batch["sequence"].tolist(), batch["start"].tolist(), strict=True))


def sequences_of(batch: Batch) -> list[str]:
    """Name of the sequence that each window of a batch is of."""
    return [name.rpartition("/")[0] for name in batch["names"]]


def distance_mm(predicted: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """Mean distance in mm of vertices (..., 3) in metres."""
    return 1000 * (predicted.detach() - true).norm(dim=-1).mean()
