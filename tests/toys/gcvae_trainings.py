"""Trainings of a few steps on the toy tube, and what they leave."""

from pathlib import Path

import torch

from drapeline.models.gcvae.settings import ConditioningSettings
from drapeline.models.gcvae.train import train_conditioning
from drapeline.models.training.checkpoints import read_checkpoint
from drapeline.models.training.lightning import TrainingRun
from drapeline.models.training.module import BEST
from toys.threads import THREADS

CONDITIONING = ConditioningSettings(condition=4, training={"steps": 72, "batch": 8})


class Killed(Exception):
    """Stands for the signal."""


def train_condition(folder: Path, garments, settings: ConditioningSettings = CONDITIONING) -> Path:
    """Train the conditioning autoencoder; returns the finished folder."""
    progress = folder.with_name(f"{folder.name}_progress")
    run = TrainingRun(folder, progress, "c", THREADS, {"accelerator": "cpu", "devices": 1})
    train_conditioning(garments, settings, run)
    return folder


def weights(folder: Path) -> dict[str, torch.Tensor]:
    """Those that a finished training leaves."""
    return read_checkpoint(folder / BEST).weights


def assert_same(first: dict[str, torch.Tensor], second: dict[str, torch.Tensor]) -> None:
    """The same names, and close values."""
    assert first.keys() == second.keys()
    for key, value in first.items():
        torch.testing.assert_close(value, second[key], msg=key)


def checkpoint_under_way(progress: Path) -> Path:
    """The last checkpoint of the one training that a folder holds."""
    (path,) = progress.glob("*/last.ckpt")
    return path
