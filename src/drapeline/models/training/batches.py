"""Batches of garments for training, read from memory-mapped arrays."""

from collections.abc import Iterator, Sequence
from typing import Any, Protocol

import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset, Sampler

from drapeline.errors import InputError
from drapeline.seeding import rng_for

Batch = dict[str, Any]


class Garments(Protocol):
    """Rows that a network can be trained on."""

    def rows(self, split: str) -> np.ndarray:
        """Indices of the rows of a split."""

    def topology(self, rows: np.ndarray) -> np.ndarray:
        """(n,) codes of `TOPOLOGIES`."""

    def mirrored_cvar(self, rows: np.ndarray) -> np.ndarray:
        """(n, C) conditions of the rows' mirror images, as closed-form networks take them."""

    def batch(self, rows: np.ndarray) -> Batch:
        """`offsets` (B, V, 3), `mask` (B, V), `cvar` (B, C), `topology` (B,), `names`, ..."""


def as_tensors(batch: Batch) -> Batch:
    """The same with arrays as tensors."""
    return {
        key: torch.from_numpy(np.ascontiguousarray(value)) if hasattr(value, "dtype") else value
        for key, value in batch.items()
    }


def refuse_unfinite(values: np.ndarray, names: Sequence[str], what: str) -> None:
    """Check an array (n, ...) that statistics are made from.

    Args:
        names: (n,) of its rows.
        what: it holds, for the message.

    Raises:
        InputError: names the samples whose values are not all finite.
    """
    finite = np.isfinite(values).all(axis=tuple(range(1, values.ndim)))
    if not finite.all():
        bad = ", ".join(name for name, fine in zip(names, finite, strict=True) if not fine)
        raise InputError(f"samples {bad}: {what} hold NaN or infinity, expected finite numbers")


class _Rows(Dataset):
    """Whole batches at once: one fancy index per array in place of one per sample."""

    def __init__(self, garments: Garments) -> None:
        self.garments = garments

    def __getitem__(self, rows: list[int]) -> Batch:
        rows = np.sort(np.asarray(rows))
        # Rows of one topology side by side, as the network takes them.
        rows = rows[np.argsort(self.garments.topology(rows), kind="stable")]
        return as_tensors(self.garments.batch(rows))


class _Batches(Sampler):
    """Batches of even size; shuffled by seed and epoch alone where there is a seed.

    Of several processes each takes its share, and as many as the others, for they wait for one
    another in every step.

    Args:
        rows: to take.
        size: of a batch, about.
        seed: of the order; None keeps it.
        processes: how many there are.
        rank: which of them this is.
    """

    def __init__(
        self, rows: np.ndarray, size: int, seed: int | None, processes: int = 1, rank: int = 0
    ) -> None:
        self.rows, self.seed, self.epoch = rows, seed, 0
        self.processes, self.rank = processes, rank
        self.count = max(1, round(len(rows) / (size * processes)))

    def set_epoch(self, epoch: int) -> None:
        """Called by the trainer, after a resume too."""
        self.epoch = epoch

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[list[int]]:
        rows = self.rows
        if self.seed is not None:
            rows = rng_for(self.seed, "epoch", self.epoch).permutation(rows)
        total = self.count * self.processes
        rows = np.resize(rows, max(len(rows), total))  # fewer than processes: some come again
        parts = np.array_split(rows, total)[self.rank :: self.processes]
        yield from (part.tolist() for part in parts)


class GarmentData:
    """Training and validation batches; the test rows are for evaluation and are not read here.

    Args:
        garments: where batches come from.
        batch: samples per step.
        seed: of the order of the training rows.

    Raises:
        InputError: the training or the validation split is empty.
    """

    def __init__(self, garments: Garments, *, batch: int, seed: int) -> None:
        self.garments, self.batch, self.seed = garments, batch, seed
        for split in ("train", "val"):
            if len(garments.rows(split)) == 0:
                raise InputError(
                    f"the {split} split holds no garments, expected one or more;"
                    " ask for more samples or for a larger share"
                )

    def loader(self, split: str, *, processes: int = 1, rank: int = 0) -> DataLoader:
        """Shuffled batches of the training split, or those of the validation split in order.

        Args:
            split: "train" or "val".
            processes: that train together, each on its share of the batches.
            rank: which of them this is.
        """
        seed = self.seed if split == "train" else None
        sampler = _Batches(self.garments.rows(split), self.batch, seed, processes, rank)
        return DataLoader(_Rows(self.garments), sampler=sampler, batch_size=None)


def cvar_statistics(cvar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and deviation (C,) over the training rows.

    What hardly varies in training counts as deviation 1: elsewhere it may.
    """
    std = cvar.std(axis=0)
    return cvar.mean(axis=0).astype(np.float32), np.where(std > 0.05, std, 1).astype(np.float32)
