"""Train the displacement of a model of SMPLicit: from data and settings to a finished folder."""

from pathlib import Path
from typing import Any

import numpy as np

from drapeline.learning_data.pose_displacements import DisplacementData
from drapeline.models.smplicit.displacement_network import DisplacementField
from drapeline.models.smplicit.displacement_settings import DisplacementTraining
from drapeline.models.training.batches import Batch, TrainingBatches
from drapeline.models.training.digests import arrays_digest
from drapeline.models.training.lightning import fit


class _Edges:
    """Rows as `TrainingBatches` takes them, with some edges of the cloth."""

    def __init__(self, data: DisplacementData, training: DisplacementTraining) -> None:
        self._data, self._training = data, training

    def rows(self, split: str) -> np.ndarray:
        return self._data.rows(split)

    def batch(self, rows: np.ndarray) -> Batch:
        return self._data.batch(rows, self._training.edges, self._training.seed)


def train_displacement(
    folder: str | Path,
    model: DisplacementField,
    data: DisplacementData,
    *,
    code: str,
    progress: str | Path,
    trainer: dict[str, Any],
    threads: int,
) -> None:
    """Train a displacement and leave a folder as `fit` does.

    Args:
        folder, progress, trainer, threads: see `fit`.
        model: untrained.
        data: of training and validation rows.
        code: digest of the code; only the same code resumes a training.

    Raises:
        InputError: the loss is not finite.
    """
    training = model.settings.training
    about = {
        "checkpoint_type": model.checkpoint_type,
        "name": model.name,
        **model.settings.plain(),
        "data": arrays_digest(data.arrays() | {"clusters": model.place_basis.numpy()}),
        "code": code,
    }
    fit(
        model,
        TrainingBatches(_Edges(data, training), batch=training.batch, seed=training.seed),
        folder,
        progress=progress,
        epochs=training.epochs,
        monitor="val_loss",
        settings=about,
        trainer=trainer,
        threads=threads,
    )
