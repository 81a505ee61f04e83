"""Train a model of SMPLicit: from data and settings to a finished folder."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from drapeline.bodies.model import load_bodies
from drapeline.job import Job
from drapeline.learning_data.garment_fields import FieldData
from drapeline.models.smplicit.model import save_model_files
from drapeline.models.smplicit.network import GarmentField, new_field
from drapeline.models.smplicit.settings import FieldSettings
from drapeline.models.training.batches import Batch, TrainingBatches, refuse_unfinite
from drapeline.models.training.checkpoints import arrays_digest, begin_with
from drapeline.models.training.lightning import TrainingRun, fit


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
    model: GarmentField,
    data: FieldData,
    run: TrainingRun,
    complete: Callable[[Path], None] | None = None,
    start: str = "",
) -> None:
    """Train a model on the training rows and leave a folder as `fit` does; see there.

    Args:
        start: folder of the model whose weights it begins with, if any.

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
        "start": start,
    }
    fit(
        model,
        TrainingBatches(_Visits(data, training.visits), batch=training.batch, seed=training.seed),
        run,
        monitor="val_distance_mm",
        settings=about,
        complete=complete,
    )


def train(job: Job) -> None:
    """SMPLicit's decoder, image encoder and styles for some garment types."""
    params, bodies, data = job.params, load_bodies(job.input), FieldData(job.input.data)
    model = new_field(params.name, data, bodies, FieldSettings(**params.settings))
    begin_with(model, params.start, own=["styles"])
    train_field(
        model,
        data,
        TrainingRun.of(job),
        lambda folder: save_model_files(folder, model, data, bodies),
        params.start["folder"],
    )
