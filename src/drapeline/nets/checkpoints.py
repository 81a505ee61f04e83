"""Trained networks from their checkpoint files; nothing in a file is executed."""

import pickle
from pathlib import Path
from typing import Any

import torch

from drapeline.errors import InputError
from drapeline.nets.domain import Domain
from drapeline.nets.gcvae_training import DynamicVae, GarmentVae, StaticVae, VaeSettings
from drapeline.nets.linear_vae import LinearDynamicVae, LinearVae

_KINDS = {cls.kind: cls for cls in (StaticVae, DynamicVae, LinearVae, LinearDynamicVae)}


def read_checkpoint(path: str | Path) -> dict[str, Any]:
    """A checkpoint of ours as plain values and tensors.

    Raises:
        InputError: the file is missing, is no checkpoint, or is not one of ours.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected a checkpoint")
    try:
        checkpoint = torch.load(path, map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, RuntimeError, EOFError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            f"{path}: not readable as a checkpoint of plain weights ({reason})"
        ) from error
    if not isinstance(checkpoint, dict) or "drapeline" not in checkpoint:
        raise InputError(f"{path}: not a checkpoint of drapeline, which has a 'drapeline' entry")
    return checkpoint


def load_vae(path: str | Path) -> GarmentVae:
    """A trained SVAE or DVAE, ready to encode and decode.

    Raises:
        InputError: see `read_checkpoint`.
    """
    checkpoint = read_checkpoint(path)
    about = checkpoint["drapeline"]
    if about["kind"] not in _KINDS:
        raise InputError(
            f"{path}: holds a '{about['kind']}' network, expected {' or '.join(_KINDS)}"
        )
    settings = VaeSettings.of(about["settings"])
    model = _KINDS[about["kind"]](settings, Domain.from_tensors(about["domain"]))
    model.load_state_dict(checkpoint["state_dict"])
    return model.eval()
