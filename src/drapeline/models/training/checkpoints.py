"""Checkpoint files of trained networks; reading them executes nothing."""

import pickle
from pathlib import Path
from typing import Any

import torch

from drapeline.errors import InputError


def read_checkpoint(path: str | Path) -> dict[str, Any]:
    """A checkpoint as plain values and tensors.

    Its entry "drapeline" is what `TrainableModule.about` returned.

    Raises:
        InputError: the file is missing, is no checkpoint, or lacks the entry "drapeline".
    """
    checkpoint = read_weights(path)
    if not isinstance(checkpoint, dict) or "drapeline" not in checkpoint:
        raise InputError(f"{path}: not a checkpoint of drapeline, which has a 'drapeline' entry")
    return checkpoint


def read_weights(path: str | Path) -> Any:
    """Plain values and tensors that torch wrote.

    Raises:
        InputError: the file is missing, or holds anything else.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected a checkpoint")
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, RuntimeError, EOFError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            f"{path}: not readable as a checkpoint of plain weights ({reason})"
        ) from error
