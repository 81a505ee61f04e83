"""Base class of all trained networks: optimiser, logs, a stop at NaN.

They are trained by Lightning, see `lightning`, but know nothing of it: it takes seconds to import,
which a job that only uses a trained network is spared.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, Protocol

import torch

from drapeline.errors import InputError
from drapeline.models.training.batches import Batch
from drapeline.models.training.settings import Training

# Files in the folder of a training.
BEST, SETTINGS = "best.safetensors", "settings.json"
# Key of a group of parameters whose learning rate is a share of the training's.
RATE_SHARE = "rate_share"


class _HasTraining(Protocol):
    @property
    def training(self) -> Training: ...

    def plain(self) -> dict[str, Any]: ...


class Progress(NamedTuple):
    """Epoch of a training, step over all epochs, rank of the process, and share that is done."""

    epoch: int = 0
    step: int = 0
    rank: int = 0
    share: float = 0.0


class Logged(NamedTuple):
    """Means over a batch of so many rows."""

    values: dict[str, torch.Tensor]
    rows: int


class TrainableModule(torch.nn.Module, ABC):
    """A module whose `settings.training` is an `EpochTraining` or a `StepTraining`.

    Attributes:
        checkpoint_type: names the class in its checkpoints.
        progress: of its training; the start if it is not being trained.
        logged: by the steps; the trainer collects it.
    """

    checkpoint_type: ClassVar[str]
    settings: _HasTraining

    def __init__(self) -> None:
        super().__init__()
        self.progress = Progress()
        self.logged: list[Logged] = []

    @property
    def device(self) -> torch.device:
        """Device of its weights."""
        return next(self.parameters()).device

    @abstractmethod
    def training_step(self, batch: Batch) -> torch.Tensor:
        """Loss of one batch."""

    @abstractmethod
    def validation_step(self, batch: Batch) -> None:
        """Log the results of one batch of the validation rows."""

    @abstractmethod
    def checkpoint_metadata(self) -> dict[str, Any]:
        """Everything needed to rebuild the module, as plain values and tensors."""

    def optimizer(self) -> torch.optim.Optimizer:
        """Adam, as printed in the papers."""
        trained = [p for p in self.parameters() if p.requires_grad]
        return torch.optim.Adam(trained, lr=self.settings.training.learning_rate, fused=True)

    def log_means(self, stage: str, values: Mapping[str, torch.Tensor], count: int) -> None:
        """Log means over an epoch of values of a batch of `count` rows, as `{stage}_{name}`."""
        named = {f"{stage}_{key}": value.detach() for key, value in values.items()}
        self.logged.append(Logged(named, count))

    def stop_if_unfinite(
        self, loss: torch.Tensor, terms: Mapping[str, torch.Tensor], names: Sequence[str]
    ) -> None:
        """Check a loss.

        Raises:
            InputError: it is NaN or infinite; names its terms and the rows of the batch.
        """
        if torch.isfinite(loss):
            return
        values = ", ".join(f"{name} {float(term.detach()):.3g}" for name, term in terms.items())
        raise InputError(
            f"training stopped in epoch {self.progress.epoch}, step {self.progress.step}: the loss"
            f" is {float(loss.detach())} ({values}) for samples {', '.join(names)};"
            " expected a finite loss"
        )


def fastest_device(accelerator: str = "auto") -> torch.device:
    """The device that networks are run on: CUDA where there is such a device, unless told "cpu"."""
    found = accelerator != "cpu" and torch.cuda.is_available()
    return torch.device("cuda" if found else "cpu")
