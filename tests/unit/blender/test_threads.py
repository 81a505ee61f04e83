import os
import subprocess
import sys
from pathlib import Path

import pytest

from drapeline.blender.threads import limit_visible_cores

SOURCE = Path(__file__).parents[3] / "src"
# Started on its own: bpy can be loaded once in a process. Asks oneTBB how many threads it made.
LOADED = """
import ctypes, os
from drapeline.blender.threads import limit_visible_cores
with limit_visible_cores(1):
    import bpy
library = ctypes.CDLL("libtbb.so.12", mode=os.RTLD_NOLOAD | os.RTLD_LAZY)
ask = library._ZN3tbb6detail2r127global_control_active_valueEi
ask.restype = ctypes.c_size_t
print(ask(0), len(os.sched_getaffinity(0)))
"""


def test_blender_makes_no_more_threads_than_it_was_shown_cores():
    cores = len(os.sched_getaffinity(0))
    done = subprocess.run(
        [sys.executable, "-c", LOADED],
        env={**os.environ, "PYTHONPATH": str(SOURCE)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["1", str(cores)]


def test_all_cores_are_back_after_an_error():
    cores = os.sched_getaffinity(0)
    with pytest.raises(RuntimeError, match="stop"), limit_visible_cores(1):
        assert len(os.sched_getaffinity(0)) == 1
        raise RuntimeError("stop")
    assert os.sched_getaffinity(0) == cores
