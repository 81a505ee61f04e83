"""Train a model of SMPLicit: from data and settings to a finished folder."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from drapeline.bodies.model import load_bodies
from drapeline.job import Job
from drapeline.learning_data.garment_fields import FieldData
from drapeline.models.smplicit.model import save_model_files
from drapeline.models.smplicit.network import GarmentField, new_field
from drapeline.models.smplicit.settings import FieldSettings
from drapeline.models.training.batches import Batch, TrainingBatches, refuse_unfinite
from drapeline.models.training.checkpoints import arrays_digest
from drapeline.models.training.lightning import fit


class _Visits:
    """Rows as `TrainingBatches` takes them, each training row several times per epoch."""

    def __init__(self, data: FieldData, visits: int) -> None:
        self._data, self._visits = data, visits

    def rows(self, split: str) -> np.ndarray:
        rows = self._data.rows(split)
        return np.tile(rows, self._visits) if split == "train" else rows

    def batch(self, rows: np.ndarray) -> Batch:
        return self._data.batch(rows)


def train_field(
    folder: str | Path,
    model: GarmentField,
    data: FieldData,
    *,
    code: str,
    progress: str | Path,
    trainer: dict[str, Any],
    threads: int,
    complete: Callable[[Path], None] | None = None,
) -> None:
    """Train a model and leave a folder as `fit` does.

    Args:
        folder, progress, trainer, threads, complete: see `fit`.
        data: of training and validation rows.
        code: digest of the code; only the same code resumes a training.

    Raises:
        InputError: a point, a distance or the loss is not finite.
    """
    rows = data.rows("train")
    for name in ("near_distance", "space_distance"):
        refuse_unfinite(getattr(data, name)[rows], data.names(rows), "distances")
    training = model.settings.training
    about = {
        "checkpoint_type": model.checkpoint_type,
        "name": model.name,
        **model.settings.plain(),
        "data": arrays_digest(data.arrays()),
        "code": code,
    }
    fit(
        model,
        TrainingBatches(_Visits(data, training.visits), batch=training.batch, seed=training.seed),
        folder,
        progress=progress,
        epochs=training.epochs,
        monitor="val_distance_mm",
        settings=about,
        trainer=trainer,
        threads=threads,
        complete=complete,
    )


def train(job: Job) -> None:
    """SMPLicit's decoder, image encoder and styles for some garment types."""
    params, bodies, data = job.params, load_bodies(job.input), FieldData(job.input.data)
    model = new_field(params.name, data, bodies, FieldSettings(**params.settings))
    train_field(
        job.output[0],
        model,
        data,
        code=job.code,
        progress=job.progress,
        trainer=params.trainer,
        threads=job.threads,
        complete=lambda folder: save_model_files(folder, model, data, bodies),
    )
