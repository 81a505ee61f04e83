"""Short trainings of Garment4D on toy skirts, and batches of what they are trained on."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from drapeline.learning_data.sequences import CloudData
from drapeline.models.garment4d.data import BodySequences, Windows
from drapeline.models.garment4d.ours.final_step import fit_final_step
from drapeline.models.garment4d.ours.labels import LabelStage
from drapeline.models.garment4d.ours.model import (
    Guesser,
    fit_regression,
    guess_all,
    save_our_model,
)
from drapeline.models.garment4d.ours.train import train_labels
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.models.garment4d.stages import (
    CanonicalStage,
    GarmentStage,
    PosedStage,
    load_stage,
    save_seen_forms,
)
from drapeline.models.garment4d.train import train_stage
from drapeline.models.start import AT_RANDOM
from drapeline.models.training.batches import Batch, as_tensors
from drapeline.models.training.lightning import TrainingRun
from drapeline.registration.settings import RefineSettings
from toys.bodies import save_toy_bodies
from toys.garment4d import LABELLING, POSED
from toys.jobs import job_of
from toys.threads import THREADS


def build_canonical(
    sequences: BodySequences,
    values: Mapping[str, Mapping[str, Any]],
    cls: type[CanonicalStage] = CanonicalStage,
) -> CanonicalStage:
    """An untrained canonical stage, or its baseline, for sequences."""
    return cls(cls.SETTINGS(**values), sequences.data.space, sequences.data.label)


def train_toys(
    folder: Path,
    name: str,
    stage: GarmentStage,
    sequences: BodySequences,
    *,
    precision: str = "32-true",
) -> Path:
    """Train a stage; the folder `name` that it leaves."""
    trainer = {"accelerator": "cpu", "precision": precision}
    progress = folder / ".progress" / name
    run = TrainingRun(folder / name, progress, "c", THREADS, trainer)
    posed = isinstance(stage, PosedStage)
    complete = partial(save_seen_forms, sequences=sequences) if posed else None
    train_stage(stage, sequences, run, complete)
    return folder / name


def train_toy_labels(
    folder: Path,
    name: str,
    data: Path,
    values: Mapping[str, Mapping[str, Any]] = LABELLING,
) -> Path:
    """Train the labels of our model on a folder of clouds; the folder `name` that it leaves."""
    given = {"data": data, **save_toy_bodies(folder / "bodies")}
    progress = folder / ".progress" / name
    trainer = {"accelerator": "cpu"}
    told = {"settings": values, "trainer": trainer, "start": AT_RANDOM}
    train_labels(job_of(given, folder / name, progress, **told))
    return folder / name


def fit_toy_model(folder: Path, labels: Path, sequences: BodySequences, clouds: CloudData) -> Path:
    """Fit our model to sequences; the folder that it is saved in."""
    guesser = toy_guesser(load_stage(labels, LabelStage), sequences)
    known = fit_regression(guesser, sequences.data, clouds)
    guesses = guess_all(guesser, sequences, clouds, known)
    skinning = SkinningSettings(**POSED["skinning"])
    step = fit_final_step(sequences, skinning, guesses, RefineSettings(), "skinned")
    folder.mkdir(parents=True)
    save_our_model(folder, guesser, step, sequences)
    return folder


def toy_guesser(labels: LabelStage, sequences: BodySequences) -> Guesser:
    """First guesses for sequences, whose regression is not fitted yet."""
    return Guesser(labels, sequences.data.space, sequences.data.label)


def stage_windows(stage: GarmentStage, sequences: BodySequences) -> Windows:
    """Windows that a stage is trained on."""
    training = stage.settings.training
    return Windows(
        sequences,
        frames=training.frames,
        stride=training.stride,
        most_validated=stage.MOST_VALIDATED,
    )


def batch_of(stage: GarmentStage, sequences: BodySequences, split: str) -> Batch:
    """All windows of a split as a stage is given them."""
    windows = stage_windows(stage, sequences)
    return as_tensors(windows.batch(windows.rows(split)))
