"""Whole trainings of Garment4D: from data and settings to a finished folder."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch

from drapeline.models.garment4d.canonical_stage import CanonicalStage, PointNetStage
from drapeline.models.garment4d.data import SequenceData, Windows
from drapeline.models.garment4d.posed_stage import MgnStage, PosedStage
from drapeline.models.garment4d.stage import Stage
from drapeline.models.training.batches import GarmentData
from drapeline.models.training.digests import arrays_digest
from drapeline.models.training.lightning import fit
from drapeline.models.training.module import plain


def train_canonical(
    folder: str | Path,
    data: SequenceData,
    values: Mapping[str, Mapping[str, Any]],
    *,
    pointnet: bool = False,
    code: str,
    progress: str | Path,
    trainer: Mapping[str, Any],
    threads: int,
) -> None:
    """Train the canonical stage, or its baseline, and leave a folder as `fit` does.

    Args:
        folder, progress, trainer, threads: see `fit`.
        data: sequences of the type.
        values: settings as they stand in a config.
        pointnet: the PN++ baseline.
        code: digest of the code; a training is taken up again by the same code alone.
    """
    torch.set_num_threads(threads)
    cls = PointNetStage if pointnet else CanonicalStage
    stage = cls(cls.settings_of(values), data.space, data.label)
    _fit(stage, data, folder, code, progress, trainer, threads)


def train_posed(
    folder: str | Path,
    data: SequenceData,
    values: Mapping[str, Mapping[str, Any]],
    canonical: CanonicalStage,
    *,
    mgn: bool = False,
    code: str,
    progress: str | Path,
    trainer: Mapping[str, Any],
    threads: int,
) -> None:
    """Train the posed stage, or its baseline, on proposals from predicted canonical garments.

    Args:
        folder, progress, trainer, threads: see `fit`.
        data: sequences of the type; its proposals are changed.
        values: settings as they stand in a config.
        canonical: trained on the same data.
        mgn: the MGN* baseline.
        code: digest of the code; a training is taken up again by the same code alone.
    """
    torch.set_num_threads(threads)
    cls = MgnStage if mgn else PosedStage
    # Without gradients nothing in it depends on the mode; Lightning warns of modules that evaluate.
    stage = cls(cls.settings_of(values), canonical.train())
    data.wear(stage.predicted_canonicals(data, ("train", "val")), stage.settings.skinning)
    _fit(stage, data, folder, code, progress, trainer, threads)


def _fit(
    stage: Stage,
    data: SequenceData,
    folder: str | Path,
    code: str,
    progress: str | Path,
    trainer: Mapping[str, Any],
    threads: int,
) -> None:
    training = stage.settings.training
    windows = Windows(
        data,
        frames=training.frames,
        stride=training.stride,
        sources=training.sources,
        posed=stage.POSED,
        body_relative_points=stage.body_relative_points,
    )
    given = GarmentData(windows, batch=training.batch, seed=training.seed)
    stage.prepare(windows)
    fit(
        stage,
        given,
        folder,
        progress=progress,
        epochs=training.epochs,
        monitor="val_total",
        settings={
            **plain(asdict(stage.settings)),
            "sequences": data.name.tolist(),
            "data": arrays_digest(data.arrays()),
            **stage.given(),
            "code": code,
        },
        trainer=trainer,
        threads=threads,
    )
