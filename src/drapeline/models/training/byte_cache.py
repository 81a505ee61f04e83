"""Values kept in memory as long as their bytes fit within a bound."""

from collections.abc import Hashable
from typing import Any, Generic, TypeVar

import numpy as np
import torch

Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")


class ByteCache(Generic[Key, Value]):
    """Values by key, of at most so many bytes together; nothing that was added is dropped again.

    Epochs ask for every value equally often, so dropping an old one for a new one would gain
    nothing, and would lose all of them where the bound is just too small for an epoch.

    Args:
        bound: bytes of all values together, as `count_bytes` counts them.
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
