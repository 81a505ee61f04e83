"""Trainings of both stages of Garment4D, of their variants and of their baselines."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from drapeline.bodies.model import load_bodies
from drapeline.job import Job
from drapeline.learning_data.sequences import SequenceData
from drapeline.models.garment4d.data import BodySequences, BodySet, Windows
from drapeline.models.garment4d.final_step import fit_final_step
from drapeline.models.garment4d.reconstruct import guess_all
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
from drapeline.models.training.lightning import TrainingRun, fit
from drapeline.models.training.module import fastest_device
from drapeline.registration.settings import RefineSettings


def train_stage(
    stage: Stage,
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
        body_relative_points=stage.body_relative_points,
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
    """The network of displacements, and the final step."""
    params, sequences = job.params, _sequences(job)
    stage = _posed(job, PosedStage)

    def complete(folder: Path) -> None:
        final_step = fit_final_step(
            sequences,
            stage.settings.skinning,
            guess_all(stage.canonical, sequences),
            RefineSettings(**params.refine),
            params.proposals,
        )
        save_posed_files(folder, sequences, final_step)

    train_stage(stage, sequences, TrainingRun.of(job), complete)


def train_compared(job: Job) -> None:
    """A variant of the network of displacements, or MGN*: to compare with, not to be used."""
    stage = _posed(job, MgnStage if job.params.mgn else PosedStage)
    train_stage(stage, _sequences(job), TrainingRun.of(job))


def _posed(job: Job, stage: type[PosedStage]) -> PosedStage:
    """Untrained, on the trained canonical stage."""
    device = fastest_device(job.params.trainer["accelerator"])
    canonical = load_stage(job.input.canonical, CanonicalStage).to(device)
    settings: Any = stage.SETTINGS(**job.params.settings)
    return stage(settings, canonical)


def _sequences(job: Job) -> BodySequences:
    bodies = BodySet(load_bodies(job.input), job.params.body_points)
    return BodySequences(SequenceData(job.input.data), bodies)
