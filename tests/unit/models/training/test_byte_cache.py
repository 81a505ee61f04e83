"""What is kept, and how much of it."""

from typing import NamedTuple

import numpy as np
import torch

from drapeline.models.training.batches import ByteCache, count_bytes


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
