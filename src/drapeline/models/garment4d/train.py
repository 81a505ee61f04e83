"""A whole training of a stage: from sequences to a finished folder."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch

from drapeline.models.garment4d.stage import Stage
from drapeline.models.garment4d.windows import BodySequences, Windows
from drapeline.models.training.batches import TrainingBatches
from drapeline.models.training.checkpoints import arrays_digest
from drapeline.models.training.lightning import fit


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
