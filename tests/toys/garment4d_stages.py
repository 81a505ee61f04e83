"""Short trainings of Garment4D on toy skirts, and batches of what they are trained on."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drapeline.models.garment4d.data import BodySequences, Windows
from drapeline.models.garment4d.stages import CanonicalStage, Stage
from drapeline.models.garment4d.train import train_stage
from drapeline.models.training.batches import Batch, as_tensors
from drapeline.models.training.lightning import TrainingRun
from toys.threads import THREADS


def build_canonical(
    sequences: BodySequences,
    values: Mapping[str, Mapping[str, Any]],
    cls: type[CanonicalStage] = CanonicalStage,
) -> CanonicalStage:
    """An untrained canonical stage, or its baseline, for sequences."""
    return cls(cls.SETTINGS(**values), sequences.data.space, sequences.data.label)


def train_toys(
    folder: Path, name: str, stage: Stage, sequences: BodySequences, *, precision: str = "32-true"
) -> Path:
    """Train a stage; the folder `name` that it leaves."""
    trainer = {"accelerator": "cpu", "precision": precision}
    progress = folder / ".progress" / name
    run = TrainingRun(folder / name, progress, "c", THREADS, trainer)
    train_stage(stage, sequences, run)
    return folder / name


def stage_windows(stage: Stage, sequences: BodySequences) -> Windows:
    """Windows that a stage is trained on."""
    training = stage.settings.training
    return Windows(
        sequences,
        frames=training.frames,
        stride=training.stride,
        most_validated=stage.MOST_VALIDATED,
        body_relative_points=stage.body_relative_points,
    )


def batch_of(stage: Stage, sequences: BodySequences, split: str) -> Batch:
    """All windows of a split as a stage is given them."""
    windows = stage_windows(stage, sequences)
    return as_tensors(windows.batch(windows.rows(split)))
