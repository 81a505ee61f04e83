"""Short trainings of Garment4D on toy skirts, and batches of what they are trained on."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from drapeline.models.garment4d.data import SequenceData, Windows
from drapeline.models.garment4d.settings import Garment4dTraining
from drapeline.models.garment4d.stage import Stage
from drapeline.models.training.batches import Batch, as_tensors


def run_training(
    train: Callable[..., None],
    folder: Path,
    name: str,
    *args: Any,
    precision: str = "32-true",
    **options: Any,
) -> Path:
    """Call `train_canonical` or `train_posed`; the folder `name` that it leaves."""
    train(
        folder / name,
        *args,
        code="c",
        progress=folder / ".progress" / name,
        trainer={"accelerator": "cpu", "precision": precision},
        threads=1,
        **options,
    )
    return folder / name


def column(folder: Path, name: str) -> list[float]:
    """A column of a training's history."""
    header, *rows = (folder / "history.tsv").read_text().splitlines()
    return [float(row.split("\t")[header.split("\t").index(name)]) for row in rows]


def windows_of(
    data: SequenceData, training: Garment4dTraining, *, posed: bool, body_relative_points: bool
) -> Windows:
    """Those of a training."""
    return Windows(
        data,
        frames=training.frames,
        stride=training.stride,
        posed=posed,
        body_relative_points=body_relative_points,
    )


def batch_of(data: SequenceData, stage: Stage, split: str) -> Batch:
    """All windows of a split as the stage is given them."""
    windows = windows_of(
        data,
        stage.settings.training,
        posed=stage.POSED,
        body_relative_points=stage.body_relative_points,
    )
    return as_tensors(windows.batch(windows.rows(split)))
