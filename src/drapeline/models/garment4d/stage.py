"""What the trainings of both stages share: settings, losses that are logged, checkpoints."""

from abc import abstractmethod
from typing import Any, ClassVar

import torch

from drapeline.models.garment4d.losses import CotangentLaplacian
from drapeline.models.garment4d.settings import StageSettings
from drapeline.models.garment4d.windows import BodySequences, Windows
from drapeline.models.training.batches import Batch
from drapeline.models.training.module import TrainableModule
from drapeline.registration.to_template.garment_space import GarmentSpace
from drapeline.seeding import rng_for


class Stage(TrainableModule):
    """A stage of Garment4D in training.

    Args:
        settings: of the subclass's `SETTINGS`.
        space: of the garment type.
        label: the type's index in `LABELS`.

    Attributes:
        checkpoint_type: name of the class in checkpoints; also seeds the initial weights.
        SETTINGS: class of its settings.
        ERROR: name of the error in mm that is logged beside the loss.
        MOST_VALIDATED: validation windows of each sequence at most, see `Windows`.
    """

    checkpoint_type: ClassVar[str]
    SETTINGS: ClassVar[type[StageSettings]]
    ERROR: ClassVar[str]
    MOST_VALIDATED: ClassVar[int | None] = None

    def __init__(self, settings: StageSettings, space: GarmentSpace, label: int) -> None:
        super().__init__()
        self.settings, self.space, self.label = settings, space, label
        self.laplacian = CotangentLaplacian(space.mean, space.faces)

    @property
    def body_relative_points(self) -> bool:
        """Whether points also say where on the body they are."""
        return self.settings.network.body_relative_points

    def weight_rng(self) -> torch.Generator:
        """For the initial weights."""
        rng = rng_for(self.settings.training.seed, self.checkpoint_type, "weights")
        return torch.Generator().manual_seed(int(rng.integers(2**62)))

    # ---- what differs between stages

    @abstractmethod
    def losses(self, batch: Batch) -> tuple[dict[str, torch.Tensor], torch.Tensor]:
        """Named terms with their `total`, and `ERROR`, a scalar."""

    def dependencies(self) -> dict[str, Any]:
        """What the result depends on besides settings and data, as JSON values."""
        return {}

    def training_sequences(self, sequences: BodySequences) -> BodySequences:
        """Those sequences with all that batches of this stage hold."""
        return sequences

    def prepare(self, windows: Windows) -> None:
        """Take from the training windows what is not learned in steps."""

    # ---- training

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
        return {
            "checkpoint_type": self.checkpoint_type,
            "settings": self.settings.plain(),
            "space": {key: torch.from_numpy(value) for key, value in vars(self.space).items()},
            "label": self.label,
        }


def window_keys(batch: Batch) -> list[tuple[int, int]]:
    """Sequence and first frame of each window of a batch."""
    return list(zip(batch["sequence"].tolist(), batch["start"].tolist(), strict=True))


def sequence_names(batch: Batch) -> list[str]:
    """Name of the sequence that each window of a batch is from."""
    return [name.rpartition("/")[0] for name in batch["names"]]


def distance_mm(predicted: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """Mean distance in mm of vertices (..., 3) in metres."""
    return 1000 * (predicted.detach() - true).norm(dim=-1).mean()
