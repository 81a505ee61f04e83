"""NumPy 1 and NumPy 2 simulate the same bytes, though they promote single numbers differently."""

import os
import subprocess
import sys

import numpy as np
import pytest

SIMULATE = """
import hashlib
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from drapeline.simulation.solver import SimulationSettings
from drapeline.simulation.health import HealthBounds
from drapeline.simulation.simulate import simulate_outfit
from drapeline.xpbd.solver import cloth_solver
from toys.bodies import toy_body
from toys.cloth import dress

settings = SimulationSettings(
    steps_min=6, steps_max=6, shape_frames=7, pose_frames=3, settle_frames=0
)
dressed = dress(toy_body())
(skirt,) = dressed.outfit.garments
skirt = replace(skirt, pin=0 * skirt.pin, elastic=skirt.pin)  # an elastic waist
outfit = replace(dressed.outfit, garments=(skirt,), signed_tightness=np.array([0.1, -0.3]))
dressed = replace(dressed, outfit=outfit)
with tempfile.TemporaryDirectory() as folder:
    bounds = HealthBounds(stretch_low=0, stretch_high=9, depth_m=1)
    status = simulate_outfit(
        f"{folder}/1", dressed, cloth_solver(1, "cpu"), settings=settings, bounds=bounds
    )
    assert status["status"] == "accepted", status["reason"]
    for path in sorted(Path(folder, "1").glob("*.*[2z]")):
        print(path.name, hashlib.sha256(path.read_bytes()).hexdigest())
"""


@pytest.mark.skipif(np.__version__[0] != "1", reason="NumPy 2 has rules of its own alone")
def test_a_sample_is_the_same_by_the_rules_of_numpy_2():
    path = os.pathsep.join(sys.path)
    legacy, weak = (
        subprocess.run(
            [sys.executable, "-c", SIMULATE],
            env=os.environ | {"PYTHONPATH": path, "NPY_PROMOTION_STATE": rules},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for rules in ("legacy", "weak")
    )
    assert [line.split()[0] for line in legacy.splitlines()] == ["Skirt.f32", "health.npz"]
    assert legacy == weak
