"""Searches among points, made anew or answered from memory.

The clouds of a training window come again in every epoch, and with them the searches of a network's
layers, which take a large part of its forward pass.
"""

from collections.abc import Callable, Hashable, Sequence
from typing import Any

import torch

from drapeline.models.training.byte_cache import ByteCache, count_bytes

Answer = torch.Tensor | tuple[torch.Tensor, ...]


class Searches:
    """How layers search during a forward pass; this class makes every search it is asked for.

    Layers name their searches and pass themselves on to their parts, so that each search of a pass
    has a path of its own, the same one in every pass.
    """

    def __call__(self, name: str, search: Callable[..., Answer], *args: Any) -> Answer:
        """The answer of `search(*args)`, a tensor or a tuple of tensors with a row per cloud.

        Args:
            name: of the search, which no other one has in this part.
            search: a function of `point_search`.
        """
        return search(*args)

    def within(self, part: str) -> "Searches":
        """The searches of a part of the network."""
        return self


SEARCH_ANEW = Searches()


class SearchMemory:
    """Answers to searches among the clouds of windows, by window and path of the search.

    Args:
        bound: bytes; searches whose answers there is no room for are made again.
    """

    def __init__(self, bound: int) -> None:
        self._answers: ByteCache[Hashable, list[torch.Tensor]] = ByteCache(bound)

    def of(self, windows: Sequence[Hashable]) -> Searches:
        """Searches for one forward pass over the clouds of these windows.

        Args:
            windows: in the order of the clouds, each with the same number of them. The clouds of
                a window, and what the network searches for in them, must be the same in every pass.
        """
        return _RememberedSearches(self._answers, windows, "", set())


class _RememberedSearches(Searches):
    """Searches of one pass, of which those made before are answered from memory."""

    def __init__(
        self,
        answers: ByteCache[Hashable, list[torch.Tensor]],
        windows: Sequence[Hashable],
        path: str,
        made: set[str],
    ) -> None:
        self._answers, self._windows, self._path, self._made = answers, windows, path, made

    def within(self, part: str) -> Searches:
        return _RememberedSearches(self._answers, self._windows, f"{self._path}{part}/", self._made)

    def __call__(self, name: str, search: Callable[..., Answer], *args: Any) -> Answer:
        path = self._path + name
        if path in self._made:
            raise ValueError(f"two searches of a forward pass are named '{path}', expected one")
        self._made.add(path)
        keys = [(window, path) for window in self._windows]
        if all(key in self._answers for key in keys):
            return _join([self._answers[key] for key in keys])
        answer = search(*args)
        for key, part in zip(keys, _split(answer, len(keys)), strict=True):
            if self._answers.has_room(count_bytes(part)):
                self._answers.add(key, [x.clone() for x in part])  # not a view of all windows
        return answer


def _split(answer: Answer, count: int) -> list[list[torch.Tensor]]:
    """Rows of each of `count` windows, indices as 32-bit integers."""
    tensors = answer if isinstance(answer, tuple) else (answer,)
    narrow = [x if x.is_floating_point() else x.to(torch.int32) for x in tensors]
    return [list(part) for part in zip(*(x.chunk(count) for x in narrow), strict=True)]


def _join(parts: Sequence[Sequence[torch.Tensor]]) -> Answer:
    """One answer about all windows."""
    whole = [torch.cat(x) for x in zip(*parts, strict=True)]
    wide = tuple(x if x.is_floating_point() else x.long() for x in whole)
    return wide if len(wide) > 1 else wide[0]
