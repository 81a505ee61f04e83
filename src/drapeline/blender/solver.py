"""Blender's cloth for the rule `simulate_outfits`, on as many cores as the rule has."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from drapeline.simulation.solver import ClothSolver


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


def cloth_solver(threads: int, accelerator: str = "cpu") -> ClothSolver:
    """Blender's cloth, on so many cores and no GPU; nothing may have imported `bpy` before."""
    with limit_visible_cores(threads):
        from drapeline.blender.cloth import BlenderCloth
    return BlenderCloth()
