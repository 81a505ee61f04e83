import os
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

from drapeline.blender.solver import cloth_solver, limit_visible_cores
from drapeline.geometry.point_cache import PointCache
from drapeline.simulation.settings import HealthBounds, SimulationSettings
from drapeline.simulation.simulate import simulate_outfit
from toys.cloth import FRAMES, dress, skirt

SOURCE = Path(__file__).parents[3] / "src"
# Started on its own: bpy can be loaded once in a process. Asks oneTBB how many threads it made.
LOADED = """
import ctypes, os
from drapeline.blender.solver import limit_visible_cores
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
    assert done.stdout.splitlines()[-1].split() == ["1", str(cores)]  # after what Blender says


def test_all_cores_are_back_after_an_error():
    cores = os.sched_getaffinity(0)
    with pytest.raises(RuntimeError, match="stop"), limit_visible_cores(1):
        assert len(os.sched_getaffinity(0)) == 1
        raise RuntimeError("stop")
    assert os.sched_getaffinity(0) == cores


def test_blender_is_named_with_its_numbers_and_version():
    solver = cloth_solver(1)
    assert solver.name == "blender"
    assert solver.settings["collision_steps"] == 2
    assert solver.versions() == {"bpy": bpy.app.version_string}


def test_a_skirt_follows_the_body_and_is_accepted(tmp_path, toy_body):
    status = simulate_outfit(
        tmp_path / "00001",
        dress(toy_body),
        cloth_solver(1),
        settings=SimulationSettings(
            steps_min=6,
            steps_max=6,
            shape_frames=2,
            pose_frames=3,
            settle_frames=0,
            collider_share=0.5,
        ),
        bounds=HealthBounds(stretch_low=0, stretch_high=9),
    )
    assert status["status"] == "accepted", status["reason"]
    with PointCache(tmp_path / "00001/Skirt.f32", len(skirt().vertices)) as cache:
        frames = cache.frames()
    assert len(frames) == FRAMES
    # The waistband stays at the waist, the hem falls in folds.
    assert np.abs(frames[:, :36].mean(axis=1) - skirt().vertices[:36].mean(axis=0)).max() < 0.02
    assert np.abs(frames[-1] - skirt().vertices).max() > 0.005
