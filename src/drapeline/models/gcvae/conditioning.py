"""The conditioning autoencoder Gamma, whose middle layer the networks are conditioned on."""

from pathlib import Path

import numpy as np
import torch
from torch import nn

from drapeline.errors import InputError
from drapeline.models.layers.linear import linear
from drapeline.models.training.checkpoints import Checkpoint


class ConditioningAutoencoder(nn.Module):
    """{cvar, cvar^z} = Gamma(cvar), an autoencoder with one skip connection (CLOTH3D 4.2).

    The skip runs from the input to the middle layer. If it bypassed the middle layer, the
    reconstruction could do without cvar^z, which is all that the other networks see.

    Args:
        inputs: size of cvar.
        hidden, middle: widths of the hidden layers and of cvar^z.
        mean, std: (inputs,) of cvar over the training set.
        rng: source of the initial weights.
    """

    def __init__(
        self,
        inputs: int,
        hidden: int,
        middle: int,
        *,
        mean: torch.Tensor,
        std: torch.Tensor,
        rng: torch.Generator,
    ) -> None:
        super().__init__()
        self.into = nn.Sequential(
            linear(inputs, hidden, rng), nn.ReLU(), linear(hidden, middle, rng)
        )
        self.skip = linear(inputs, middle, rng)
        self.out = nn.Sequential(
            linear(middle, hidden, rng), nn.ReLU(), linear(hidden, inputs, rng)
        )
        self.register_buffer("mean", mean.clone())
        self.register_buffer("std", std.clone())

    def normalise(self, cvar: torch.Tensor) -> torch.Tensor:
        """(B, C) -> (B, C) with zero mean and unit deviation over the training set."""
        return (cvar - self.mean) / self.std

    def forward(self, cvar: torch.Tensor) -> torch.Tensor:
        """(B, C) -> cvar^z (B, middle)."""
        x = self.normalise(cvar)
        return self.into(x) + self.skip(x)

    def loss(self, cvar: torch.Tensor) -> torch.Tensor:
        """L1 between normalised cvar and its reconstruction."""
        return (self.out(self(cvar)) - self.normalise(cvar)).abs().mean()


def cvar_statistics(cvar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and deviation (C,) float32 of the conditions (n, C) of the training rows.

    A condition that hardly varies in training has deviation 1, since it may vary elsewhere.
    """
    std = cvar.std(axis=0)
    return cvar.mean(axis=0).astype(np.float32), np.where(std > 0.05, std, 1).astype(np.float32)


def load_conditioning(checkpoint: Checkpoint, into: ConditioningAutoencoder, path: Path) -> None:
    """Copy trained weights into an autoencoder.

    Args:
        checkpoint: as `train_conditioning` leaves it.
        into: gets the weights.
        path: of the checkpoint, for messages.

    Raises:
        InputError: the checkpoint is of another network or another size.
    """
    prefix = "autoencoder."
    state = {
        key.removeprefix(prefix): value
        for key, value in checkpoint.weights.items()
        if key.startswith(prefix)
    }
    try:
        into.load_state_dict(state)
    except RuntimeError as error:
        raise InputError(
            f"{path}: holds a conditioning network of another size than the settings ask for"
            f" ({str(error).splitlines()[-1].strip()})"
        ) from error
