"""Launches of kernels that a small step repeats."""

from collections.abc import Callable, Sequence

import numpy as np
import warp as wp


def record(kernel: wp.Kernel, count: int, inputs: list, outputs: list) -> wp.Launch | None:
    """A launch to repeat; nothing if `count`, the number of its threads, is 0."""
    return wp.launch(kernel, dim=count, inputs=inputs, outputs=outputs, record_cmd=True)


class Replay:
    """Launches that are always the same, recorded when they are first called for, to be replayed.

    One by one, each would take Python several microseconds.

    Args:
        parts: make the launches, in order.
    """

    def __init__(self, parts: Sequence[Callable[[], None]]) -> None:
        self._parts = parts
        self._graph: wp.Graph | None = None

    def __call__(self) -> None:
        """Make all launches."""
        if self._graph is None:
            with wp.ScopedCapture() as capture:
                for part in self._parts:
                    part()
            self._graph = capture.graph
        wp.capture_launch(self._graph)


class BusyLaunch:
    """A launch to repeat for those vertices or edges that are near to something, and no others.

    On a GPU, which would wait for their numbers, it is one for all, of which most end at once.

    Args:
        kernel: takes their numbers and `count` before its `inputs`.
        count: (N,) how much each of all of them is near to.
        inputs, outputs: of the kernel.
    """

    def __init__(self, kernel: wp.Kernel, count: wp.array, inputs: list, outputs: list) -> None:
        self._count = count
        self._numbers = wp.array(np.arange(len(count), dtype=np.int32), dtype=int)
        self._launch = record(kernel, 1, [self._numbers, count, *inputs], outputs)
        self._launch.set_dim(0)

    def find(self) -> None:
        """Find them again, after `count` has changed."""
        if self._count.device.is_cuda:
            self._launch.set_dim(len(self._count))
            return
        busy = np.flatnonzero(self._count.numpy())
        self._numbers.numpy()[: len(busy)] = busy
        self._launch.set_dim(len(busy))

    def launch(self) -> None:
        """Launch the kernel for those that were found."""
        self._launch.launch()
