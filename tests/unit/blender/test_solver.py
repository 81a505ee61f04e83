import bpy
import numpy as np

from drapeline.blender.solver import cloth_solver
from drapeline.geometry.point_cache import PointCache
from drapeline.simulation.settings import HealthBounds, SimulationSettings
from drapeline.simulation.simulate import simulate_outfit
from toys.cloth import FRAMES, dress, skirt


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
            steps_min=6, steps_max=6, shape_frames=2, pose_frames=3, collider_share=0.5
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
