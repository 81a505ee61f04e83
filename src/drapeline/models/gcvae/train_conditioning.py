"""Train the conditioning autoencoder, alone and before the networks that it conditions."""

from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch

from drapeline.models.gcvae.conditioning import ConditioningAutoencoder, cvar_statistics
from drapeline.models.gcvae.settings import ConditioningSettings
from drapeline.models.training.batches import Batch, TrainingBatches, refuse_unfinite
from drapeline.models.training.lightning import fit
from drapeline.models.training.module import TrainableModule
from drapeline.seeding import rng_for


class Conditions(Protocol):
    """Rows of a dataset with their conditions."""

    def rows(self, split: str) -> np.ndarray:
        """Indices of the rows of a split."""

    def cvar(self, rows: np.ndarray) -> np.ndarray:
        """(n, C)."""

    def names(self, rows: np.ndarray) -> list[str]:
        """Names of rows, for messages."""


class ConditionRows:
    """Conditions as rows to train on, without their garments."""

    def __init__(self, conditions: Conditions) -> None:
        self.rows, self._conditions = conditions.rows, conditions

    def batch(self, rows: np.ndarray) -> Batch:
        """`cvar` (B, C) float32 and `names`."""
        cvar = self._conditions.cvar(rows).astype(np.float32)
        return {"cvar": cvar, "names": self._conditions.names(rows)}


class ConditioningTraining(TrainableModule):
    """The autoencoder Gamma with its L1 loss.

    Args:
        settings: sizes and training.
        mean, std: (C,) of the conditions over the training rows.
    """

    checkpoint_type = "conditioning"

    def __init__(self, settings: ConditioningSettings, mean: np.ndarray, std: np.ndarray) -> None:
        super().__init__()
        self.settings = settings
        rng = rng_for(settings.training.seed, "conditioning")
        self.autoencoder = ConditioningAutoencoder(
            len(mean),
            2 * settings.condition,
            settings.condition,
            mean=torch.from_numpy(mean),
            std=torch.from_numpy(std),
            rng=torch.Generator().manual_seed(int(rng.integers(2**62))),
        )

    def training_step(self, batch: Batch) -> torch.Tensor:
        """L1 of the reconstruction."""
        loss = self.autoencoder.loss(batch["cvar"])
        self.stop_if_unfinite(loss, {"reconstruction": loss}, batch["names"])
        self.log_means("train", {"loss": loss}, len(batch["cvar"]))
        return loss

    def validation_step(self, batch: Batch) -> None:
        """The same on validation rows."""
        loss = self.autoencoder.loss(batch["cvar"])
        self.log_means("val", {"loss": loss}, len(batch["cvar"]))

    def checkpoint_metadata(self) -> dict[str, Any]:
        """Type and settings; the statistics are among the weights."""
        return {"checkpoint_type": self.checkpoint_type, "settings": self.settings.plain()}


def train_conditioning(
    folder: str | Path,
    conditions: Conditions,
    settings: ConditioningSettings,
    *,
    code: str,
    progress: str | Path,
    threads: int,
) -> None:
    """Train on the training rows and leave a folder as `fit` does.

    Args:
        folder, progress, threads: see `fit`.
        conditions: of training and validation rows.
        settings: sizes and training.
        code: digest of the code; only the same code resumes a training.

    Raises:
        InputError: a condition, or later the loss, is not finite; names the samples.
    """
    rows, training = conditions.rows("train"), settings.training
    cvar = conditions.cvar(rows)
    refuse_unfinite(cvar, conditions.names(rows), "conditions")
    mean, std = cvar_statistics(cvar)
    fit(
        ConditioningTraining(settings, mean, std),
        TrainingBatches(ConditionRows(conditions), batch=training.batch, seed=training.seed),
        folder,
        progress=progress,
        epochs=training.epochs,
        monitor="val_loss",
        settings={
            **settings.plain(),
            "mean": mean.tolist(),
            "std": std.tolist(),
            "code": code,
        },
        trainer={"accelerator": "cpu", "devices": 1},
        threads=threads,
    )
