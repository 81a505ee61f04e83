"""What the Lightning modules of all networks share: learning rate, logs, a stop at NaN."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import pytorch_lightning as lightning
import torch

from drapeline.errors import InputError
from drapeline.nets.fitting import learning_rate
from drapeline.nets.gcvae_data import Batch


@dataclass(frozen=True)
class Training:
    """How long and how fast a network is trained.

    Attributes:
        epochs: passes over the training rows; schedules are in shares of it.
        batch: rows per step.
        learning_rate: of Adam.
        schedule: "constant", or "one_cycle": a short rise, then a cosine to zero.
        seed: of weights, order and noise.
    """

    epochs: int = 100
    batch: int = 32
    learning_rate: float = 1e-3
    schedule: str = "constant"
    seed: int = 0


class _Settings(Protocol):
    training: Training


class Trained(lightning.LightningModule, ABC):
    """A module whose `settings.training` is a `Training`."""

    settings: _Settings

    @abstractmethod
    def about(self) -> dict[str, Any]:
        """All that is needed to build the module again, as plain values and tensors."""

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Put in all that is needed to build the module again."""
        checkpoint["drapeline"] = self.about()

    def on_train_batch_start(self, batch: Batch, index: int) -> None:
        """Set the learning rate from the step alone."""
        training = self.settings.training
        share = self.global_step / self.trainer.estimated_stepping_batches
        rate = learning_rate(training.learning_rate, training.schedule, share)
        for group in self.optimizers().param_groups:
            group["lr"] = rate

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Adam, as printed in the papers."""
        trained = [p for p in self.parameters() if p.requires_grad]
        return torch.optim.Adam(trained, lr=self.settings.training.learning_rate)

    def log_means(self, stage: str, values: Mapping[str, torch.Tensor], count: int) -> None:
        """Log means over an epoch of values of a batch of `count` rows, as `{stage}_{name}`."""
        named = {f"{stage}_{key}": value.detach() for key, value in values.items()}
        self.log_dict(named, on_step=False, on_epoch=True, batch_size=count, sync_dist=True)

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
            f"training stopped in epoch {self.current_epoch}, step {self.global_step}: the loss"
            f" is {float(loss.detach())} ({values}) for samples {', '.join(names)};"
            " expected a finite loss"
        )


def fastest_device() -> torch.device:
    """What trained networks are run on: a CUDA device where there is one."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def plain(value: Any) -> Any:
    """Tuples as lists, so that a checkpoint holds nothing but plain values."""
    if isinstance(value, dict):
        return {key: plain(part) for key, part in value.items()}
    return [plain(part) for part in value] if isinstance(value, tuple | list) else value
