"""Batches of rows, in which order and for which process, and values that are kept."""

from typing import NamedTuple

import numpy as np
import pytest
import torch

from drapeline.errors import InputError
from drapeline.models.training.batches import (
    ByteCache,
    TrainingBatches,
    _BatchSampler,
    count_bytes,
    refuse_unfinite,
)
from toys.gcvae import ToyGarments


@pytest.mark.parametrize("split", ["train", "val"])
def test_an_empty_split_is_refused(split):
    garments = ToyGarments()
    garments.split[garments.split == split] = "test"
    with pytest.raises(InputError, match=f"the {split} split holds no garments"):
        TrainingBatches(garments, batch=8, seed=0)


@pytest.mark.parametrize("processes", [2, 3, 50])
def test_processes_share_all_rows_in_as_many_batches_each(processes):
    rows = np.arange(10, 50)
    shares = [
        list(_BatchSampler(rows, size=8, seed=0, processes=processes, rank=rank))
        for rank in range(processes)
    ]
    assert len({len(batches) for batches in shares}) == 1
    seen = [row for batches in shares for batch in batches for row in batch]
    assert all(len(batch) for batches in shares for batch in batches)
    assert set(seen) == set(rows)
    assert len(seen) == max(len(rows), processes)


def test_every_epoch_sees_every_training_row_once_in_another_order():
    garments = ToyGarments()
    loader = TrainingBatches(garments, batch=8, seed=0).loader("train")
    orders = []
    for epoch in (0, 1, 0):
        loader.sampler.set_epoch(epoch)
        batches = list(loader)
        for batch in batches:
            assert batch["names"] == sorted(batch["names"])
        orders.append([name for b in batches for name in b["names"]])
    assert sorted(orders[0]) == sorted(garments.names(garments.rows("train")))
    assert orders[0] != orders[1]
    assert orders[0] == orders[2]


def test_rows_that_are_not_finite_are_named():
    values = np.ones((3, 2, 2))
    refuse_unfinite(values, [*"abc"], "offsets")
    values[1, 0, 1], values[2, 1, 1] = np.nan, np.inf
    with pytest.raises(InputError, match="^samples b, c: offsets hold NaN or infinity"):
        refuse_unfinite(values, [*"abc"], "offsets")


class Pair(NamedTuple):
    array: np.ndarray
    number: float


def test_bytes_are_those_of_all_arrays_and_tensors():
    array, tensor = np.zeros((2, 3), np.float32), torch.zeros(5, dtype=torch.int64)
    assert count_bytes(array) == 24
    assert count_bytes(tensor) == 40
    assert count_bytes([Pair(array, 1.0), (tensor, [tensor]), None, "word"]) == 24 + 80


def test_values_are_kept_until_the_bound_is_reached():
    cache = ByteCache(100)
    cache.add("a", np.zeros(60, np.uint8))
    cache.add("b", np.zeros(41, np.uint8))  # one byte too much
    cache.add("c", np.zeros(40, np.uint8))
    assert [key in cache for key in "abc"] == [True, False, True]
    assert len(cache["c"]) == 40
    assert cache.has_room(0)
    assert not cache.has_room(1)


def test_a_known_key_keeps_its_value_and_is_counted_once():
    cache = ByteCache(100)
    first = np.zeros(60, np.uint8)
    cache.add("a", first)
    cache.add("a", np.ones(30, np.uint8))
    assert cache["a"] is first
    assert cache.has_room(40)


def test_nothing_is_kept_without_room():
    cache = ByteCache(0)
    cache.add("a", np.zeros(1))
    assert "a" not in cache
