"""Training of the conditioning autoencoder, alone and before the networks that it conditions."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pytorch_lightning as lightning
import torch

from drapeline.errors import InputError
from drapeline.nets.conditioning import ConditioningAutoencoder
from drapeline.nets.fitting import fit, learning_rate
from drapeline.nets.gcvae_data import Batch, GarmentData, cvar_statistics
from drapeline.seeding import rng_for


@dataclass(frozen=True)
class ConditioningSettings:
    """How the autoencoder is built and trained.

    Attributes:
        condition: size of cvar^z.
        epochs: passes over the training rows.
        batch: samples per step.
        learning_rate: largest one of Adam.
        seed: of weights and order.
    """

    condition: int = 32
    epochs: int = 60
    batch: int = 32
    learning_rate: float = 3e-3
    seed: int = 0


class Conditions(Protocol):
    """Rows with conditions."""

    def rows(self, split: str) -> np.ndarray:
        """Indices of the rows of a split."""

    def cvar(self, rows: np.ndarray) -> np.ndarray:
        """(n, C)."""


class _Rows:
    """Conditions as batches without garments."""

    def __init__(self, conditions: Conditions) -> None:
        self.rows, self.cvar = conditions.rows, conditions.cvar

    def topology(self, rows: np.ndarray) -> np.ndarray:
        return np.zeros(len(rows), dtype=np.int64)

    def batch(self, rows: np.ndarray) -> Batch:
        return {"cvar": self.cvar(rows).astype(np.float32)}


class ConditioningTraining(lightning.LightningModule):
    """Gamma with its L1 loss."""

    def __init__(self, settings: ConditioningSettings, mean: np.ndarray, std: np.ndarray) -> None:
        super().__init__()
        self.settings = settings
        self.autoencoder = ConditioningAutoencoder(
            len(mean),
            2 * settings.condition,
            settings.condition,
            mean=torch.from_numpy(mean),
            std=torch.from_numpy(std),
            rng=torch.Generator().manual_seed(
                int(rng_for(settings.seed, "conditioning").integers(2**62))
            ),
        )

    def training_step(self, batch: Batch, _: int) -> torch.Tensor:
        """L1 of the reconstruction."""
        return self._loss("train", batch)

    def validation_step(self, batch: Batch, _: int) -> None:
        """The same on validation rows."""
        self._loss("val", batch)

    def _loss(self, stage: str, batch: Batch) -> torch.Tensor:
        loss = self.autoencoder.loss(batch["cvar"])
        self.log(f"{stage}_loss", loss, on_step=False, on_epoch=True, batch_size=len(batch["cvar"]))
        return loss

    def on_train_batch_start(self, *_: Any) -> None:
        """Set the learning rate from the step alone."""
        share = self.global_step / self.trainer.estimated_stepping_batches
        for group in self.optimizers().param_groups:
            group["lr"] = learning_rate(self.settings.learning_rate, "one_cycle", share)

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Adam."""
        return torch.optim.Adam(self.parameters(), lr=self.settings.learning_rate)

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Say what this is."""
        checkpoint["drapeline"] = {"kind": "conditioning"}


def train_conditioning(
    folder: str | Path,
    conditions: Conditions,
    settings: ConditioningSettings,
    *,
    progress: str | Path,
    threads: int,
) -> None:
    """Train on the training rows and leave a folder as `fit` does."""
    mean, std = cvar_statistics(conditions.cvar(conditions.rows("train")))
    fit(
        ConditioningTraining(settings, mean, std),
        GarmentData(_Rows(conditions), batch=settings.batch, seed=settings.seed),
        folder,
        progress=progress,
        epochs=settings.epochs,
        monitor="val_loss",
        settings={**vars(settings), "mean": mean.tolist(), "std": std.tolist()},
        trainer={"accelerator": "cpu"},
        threads=threads,
    )


def load_conditioning(
    checkpoint: dict[str, Any], into: ConditioningAutoencoder, path: Path
) -> None:
    """Give a network trained conditions.

    Raises:
        InputError: the checkpoint is of another network or another size.
    """
    prefix = "autoencoder."
    state = {
        key.removeprefix(prefix): value
        for key, value in checkpoint["state_dict"].items()
        if key.startswith(prefix)
    }
    try:
        into.load_state_dict(state)
    except RuntimeError as error:
        raise InputError(
            f"{path}: holds a conditioning network of another size than the settings ask for"
            f" ({str(error).splitlines()[-1].strip()})"
        ) from error
