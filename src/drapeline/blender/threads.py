"""How many cores Blender uses."""

import os
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def limit_visible_cores(count: int) -> Iterator[None]:
    """Context for the first import of `bpy`: the machine seems to have `count` cores.

    Blender makes as many workers as it sees cores when it is loaded. Limits set later leave the
    workers there, awake and yielding: that took a tenth of the processor's time, and jobs side by
    side fought for it. Where a process cannot be told its cores, Blender takes them all.
    """
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(cores)[:count])
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)
