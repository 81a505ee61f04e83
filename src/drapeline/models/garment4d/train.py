"""Trainings of both stages of Garment4D, of their variants and of their baselines."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch

from drapeline.bodies.model import load_bodies
from drapeline.job import Job
from drapeline.learning_data.sequences import SequenceData
from drapeline.models.garment4d.data import BodySequences, BodySet, Windows
from drapeline.models.garment4d.stages import (
    CanonicalStage,
    MgnStage,
    PointNetStage,
    PosedStage,
    Stage,
    load_stage,
    save_posed_files,
)
from drapeline.models.training.batches import TrainingBatches
from drapeline.models.training.checkpoints import arrays_digest
from drapeline.models.training.lightning import fit
from drapeline.models.training.module import fastest_device


def train_stage(
    folder: str | Path,
    stage: Stage,
    sequences: BodySequences,
    *,
    code: str,
    progress: str | Path,
    trainer: Mapping[str, Any],
    threads: int,
    complete: Callable[[Path], None] | None = None,
) -> None:
    """Train a stage on windows of sequences and leave a folder as `fit` does.

    Args:
        folder, progress, trainer, threads, complete: see `fit`.
        stage: with its initial weights.
        sequences: of its garment type.
        code: digest of the code; a training that was stopped goes on with the same code alone.
    """
    torch.set_num_threads(threads)
    stage.train()  # a frozen stage within it too: Lightning warns of modules in evaluation mode
    training, sequences = stage.settings.training, stage.training_sequences(sequences)
    windows = Windows(
        sequences,
        frames=training.frames,
        stride=training.stride,
        sources=training.sources,
        most_validated=stage.MOST_VALIDATED,
        body_relative_points=stage.body_relative_points,
    )
    garments = TrainingBatches(windows, batch=training.batch, seed=training.seed)
    stage.prepare(windows)
    fit(
        stage,
        garments,
        folder,
        progress=progress,
        epochs=training.epochs,
        monitor="val_total",
        settings={
            **stage.settings.plain(),
            "sequences": sequences.data.name.tolist(),
            "data": arrays_digest(sequences.arrays()),
            **stage.dependencies(),
            "code": code,
        },
        trainer=trainer,
        threads=threads,
        complete=complete,
    )


def train_canonical(job: Job) -> None:
    """A garment's points and its shape at rest; or PN++."""
    stage = PointNetStage if job.params.pointnet else CanonicalStage
    sequences = _sequences(job)
    data = sequences.data
    _train(job, stage(stage.SETTINGS(**job.params.settings), data.space, data.label), sequences)


def train_posed(job: Job) -> None:
    """The network of displacements, in one of its variants; or MGN*."""
    params, sequences = job.params, _sequences(job)
    stage = MgnStage if params.mgn else PosedStage
    device = fastest_device(params.trainer["accelerator"])
    canonical = load_stage(job.input.canonical, CanonicalStage).to(device)
    settings: Any = stage.SETTINGS(**params.settings)

    def complete(folder: Path) -> None:
        if not params.mgn:  # a baseline to compare with, not to be used
            save_posed_files(folder, sequences, settings.skinning)

    _train(job, stage(settings, canonical), sequences, complete)


def _sequences(job: Job) -> BodySequences:
    bodies = BodySet(load_bodies(job.input), job.params.body_points)
    return BodySequences(SequenceData(job.input.data), bodies)


def _train(
    job: Job, stage: Stage, sequences: BodySequences, complete: Callable[[Path], None] | None = None
) -> None:
    train_stage(
        job.output[0],
        stage,
        sequences,
        code=job.code,
        progress=job.progress,
        trainer=job.params.trainer,
        threads=job.threads,
        complete=complete,
    )
