"""Trainings of both stages of Garment4D, of their variants and of their baselines."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import torch

from drapeline.bodies.model import load_bodies
from drapeline.job import Job
from drapeline.learning_data.sequences import SequenceData
from drapeline.models.garment4d.data import BodySequences, BodySet, Windows
from drapeline.models.garment4d.stages import (
    CanonicalStage,
    GarmentStage,
    MgnStage,
    PointNetStage,
    PosedStage,
    load_stage,
    save_seen_forms,
)
from drapeline.models.training.batches import TrainingBatches
from drapeline.models.training.checkpoints import arrays_digest
from drapeline.models.training.lightning import TrainingRun, fit
from drapeline.models.training.module import fastest_device


def train_stage(
    stage: GarmentStage,
    sequences: BodySequences,
    run: TrainingRun,
    complete: Callable[[Path], None] | None = None,
) -> None:
    """Train a stage on windows of sequences and leave a folder as `fit` does; see there."""
    torch.set_num_threads(run.threads)
    stage.train()  # a frozen stage within it too: Lightning warns of modules in evaluation mode
    training, sequences = stage.settings.training, stage.training_sequences(sequences)
    windows = Windows(
        sequences,
        frames=training.frames,
        stride=training.stride,
        sources=training.sources,
        most_validated=stage.MOST_VALIDATED,
    )
    garments = TrainingBatches(windows, batch=training.batch, seed=training.seed)
    stage.prepare(windows)
    fit(
        stage,
        garments,
        run,
        monitor="val_total",
        settings={
            **stage.settings.plain(),
            "sequences": sequences.data.name.tolist(),
            "data": arrays_digest(sequences.arrays()),
            **stage.dependencies(),
        },
        complete=complete,
    )


def train_canonical(job: Job) -> None:
    """A garment's points and its shape at rest; or PN++."""
    stage = PointNetStage if job.params.pointnet else CanonicalStage
    sequences = _sequences(job)
    data = sequences.data
    untrained = stage(stage.SETTINGS(**job.params.settings), data.space, data.label)
    train_stage(untrained, sequences, TrainingRun.of(job))


def train_posed(job: Job) -> None:
    """The network of displacements, a variant of it, or MGN*."""
    sequences = _sequences(job)
    stage = _posed(job, MgnStage if job.params.mgn else PosedStage)
    complete = partial(save_seen_forms, sequences=sequences)
    train_stage(stage, sequences, TrainingRun.of(job), complete)


def _posed(job: Job, stage: type[PosedStage]) -> PosedStage:
    """Untrained, on the trained canonical stage."""
    device = fastest_device(job.params.trainer["accelerator"])
    canonical = load_stage(job.input.canonical, CanonicalStage).to(device)
    settings: Any = stage.SETTINGS(**job.params.settings)
    return stage(settings, canonical)


def _sequences(job: Job) -> BodySequences:
    bodies = BodySet(load_bodies(job.input), job.params.body_points)
    return BodySequences(SequenceData(job.input.data), bodies)
