"""Batches of rows for training, read from memory-mapped arrays, and what epochs keep in memory."""

from collections.abc import Hashable, Iterator, Sequence
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset, Sampler

from drapeline.errors import InputError
from drapeline.seeding import rng_for

Batch = dict[str, Any]


class TrainingRows(Protocol):
    """Rows that a network can be trained on: garments, windows of sequences, conditions."""

    def rows(self, split: str) -> np.ndarray:
        """Indices of the rows of a split, "train" or "val"."""

    def batch(self, rows: np.ndarray) -> Batch:
        """Arrays of rows (B,) by name, `names` of the rows among them."""


def as_tensors(batch: Batch) -> Batch:
    """The batch with its arrays as tensors."""
    return {
        key: torch.from_numpy(np.ascontiguousarray(value)) if hasattr(value, "dtype") else value
        for key, value in batch.items()
    }


def refuse_unfinite(values: np.ndarray, names: Sequence[str], what: str) -> None:
    """Check an array that statistics are computed from.

    Args:
        values: (n, ...).
        names: (n,) of its rows.
        what: the array holds, for the message.

    Raises:
        InputError: names the samples whose values are not all finite.
    """
    finite = np.isfinite(values).all(axis=tuple(range(1, values.ndim)))
    if not finite.all():
        bad = ", ".join(name for name, fine in zip(names, finite, strict=True) if not fine)
        raise InputError(f"samples {bad}: {what} hold NaN or infinity, expected finite numbers")


class _BatchDataset(Dataset):
    """Whole batches at once: one fancy index per array in place of one per sample."""

    def __init__(self, source: TrainingRows) -> None:
        self.source = source

    def __getitem__(self, rows: list[int]) -> Batch:
        return as_tensors(self.source.batch(np.sort(np.asarray(rows))))


class _BatchSampler(Sampler):
    """Batches of even size; with a seed, their order depends on seed and epoch alone.

    Each of several processes takes its share, and as many batches as the others, since they wait
    for one another in every step.

    Args:
        rows: to split into batches.
        size: about how many rows a batch has.
        seed: of the order; None keeps the rows in order.
        processes: number of processes.
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
        rows = np.resize(rows, max(len(rows), total))  # with too few rows, some are used twice
        parts = np.array_split(rows, total)[self.rank :: self.processes]
        yield from (part.tolist() for part in parts)


class TrainingBatches:
    """Training and validation batches; test rows are for evaluation and are not read here.

    Args:
        source: where the rows come from.
        batch: rows per step.

    Raises:
        InputError: the training or the validation split is empty.
    """

    def __init__(self, source: TrainingRows, *, batch: int, seed: int) -> None:
        self.source, self.batch, self.seed = source, batch, seed
        for split in ("train", "val"):
            if len(source.rows(split)) == 0:
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
        sampler = _BatchSampler(self.source.rows(split), self.batch, seed, processes, rank)
        return DataLoader(_BatchDataset(self.source), sampler=sampler, batch_size=None)


Key = TypeVar("Key", bound=Hashable)

Value = TypeVar("Value")


class ByteCache(Generic[Key, Value]):
    """Values by key, of at most `bound` bytes together; nothing that was added is dropped again.

    Epochs ask for every value equally often, so dropping an old one for a new one would gain
    nothing, and would lose all of them where the bound is just too small for an epoch.
    """

    def __init__(self, bound: int) -> None:
        self._values: dict[Key, Value] = {}
        self._room = bound

    def __contains__(self, key: Key) -> bool:
        return key in self._values

    def __getitem__(self, key: Key) -> Value:
        return self._values[key]

    def has_room(self, size: int) -> bool:
        """Whether a value of so many bytes would be kept."""
        return size <= self._room

    def add(self, key: Key, value: Value) -> None:
        """Keep a value, unless its key is known or there is no room for it."""
        size = count_bytes(value)
        if key not in self._values and self.has_room(size):
            self._values[key] = value
            self._room -= size


def count_bytes(value: Any) -> int:
    """Bytes of the arrays and tensors within nested tuples and lists; anything else counts 0."""
    if isinstance(value, np.ndarray | torch.Tensor):
        return value.nbytes
    if isinstance(value, tuple | list):
        return sum(map(count_bytes, value))
    return 0
