"""Batches of garments for training, read from memory-mapped arrays."""

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
import pytorch_lightning as lightning
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

    def batch(self, rows: np.ndarray) -> Batch:
        """`offsets` (B, V, 3), `mask` (B, V), `cvar` (B, C), `topology` (B,), `names`, ..."""


def as_tensors(batch: Batch) -> Batch:
    """The same with arrays as tensors."""
    return {
        key: torch.from_numpy(np.ascontiguousarray(value)) if hasattr(value, "dtype") else value
        for key, value in batch.items()
    }


def refuse_unfinite(batch: Batch) -> None:
    """Check arrays that statistics are made from.

    Raises:
        InputError: names the samples whose offsets are not all finite.
    """
    finite = np.isfinite(batch["offsets"]).all(axis=(1, 2))
    if not finite.all():
        names = ", ".join(
            name for name, fine in zip(batch["names"], finite, strict=True) if not fine
        )
        raise InputError(f"samples {names}: offsets hold NaN or infinity, expected metres")


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
    """Batches of even size; shuffled by seed and epoch alone where there is a seed."""

    def __init__(self, rows: np.ndarray, size: int, seed: int | None) -> None:
        self.rows, self.seed, self.epoch = rows, seed, 0
        self.count = max(1, round(len(rows) / size))

    def set_epoch(self, epoch: int) -> None:
        """Called by the trainer, after a resume too."""
        self.epoch = epoch

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[list[int]]:
        rows = self.rows
        if self.seed is not None:
            rows = rng_for(self.seed, "epoch", self.epoch).permutation(rows)
        yield from (part.tolist() for part in np.array_split(rows, self.count))


class GarmentData(lightning.LightningDataModule):
    """Training and validation batches; the test rows are for evaluation and are not read here.

    Args:
        garments: where batches come from.
        batch: samples per step.
        seed: of the order of the training rows.
        workers: processes that read ahead; memory-mapped arrays seldom need any.

    Raises:
        InputError: the training or the validation split is empty.
    """

    def __init__(self, garments: Garments, *, batch: int, seed: int, workers: int = 0) -> None:
        super().__init__()
        self.garments, self.batch, self.seed, self.workers = garments, batch, seed, workers
        for split in ("train", "val"):
            if len(garments.rows(split)) == 0:
                raise InputError(
                    f"the {split} split holds no garments, expected one or more;"
                    " ask for more samples or for a larger share"
                )

    def train_dataloader(self) -> DataLoader:
        """Shuffled batches of the training split."""
        return self._loader("train", self.seed)

    def val_dataloader(self) -> DataLoader:
        """The validation split in order."""
        return self._loader("val", None)

    def _loader(self, split: str, seed: int | None) -> DataLoader:
        sampler = _Batches(self.garments.rows(split), self.batch, seed)
        return DataLoader(
            _Rows(self.garments), sampler=sampler, batch_size=None, num_workers=self.workers
        )


def cvar_statistics(cvar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and deviation (C,) over the training rows.

    What hardly varies in training counts as deviation 1: elsewhere it may.
    """
    std = cvar.std(axis=0)
    return cvar.mean(axis=0).astype(np.float32), np.where(std > 0.05, std, 1).astype(np.float32)
