"""Garments that are simulated once more: the same, or with a rest shape a little different."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from drapeline.generation.again import change_rest_shape, simulate_again
from drapeline.geometry.point_cache import PointCache
from drapeline.seeding import rng_for
from drapeline.simulation.settings import SimulationSettings
from drapeline.simulation.simulate import measure_outfit
from drapeline.simulation.solver import plan_attempt
from drapeline.xpbd.solver import cloth_solver
from toys.cloth import Follower, dress

SETTINGS = SimulationSettings(
    steps_min=5, steps_max=7, shape_frames=2, pose_frames=3, settle_frames=1, gap_m=0.005
)


@pytest.fixture
def dressed(toy_body):
    return dress(toy_body)


@pytest.mark.parametrize("amplitude_m", [0.0, 0.001])
def test_a_rest_shape_changes_by_the_amplitude(dressed, amplitude_m):
    changed = change_rest_shape(dressed.outfit, amplitude_m, rng_for(0, "waves"))
    (before,), (after,) = dressed.outfit.garments, changed.garments
    away = np.linalg.norm(after.vertices - before.vertices, axis=1)
    assert np.sqrt((away**2).mean()) == pytest.approx(amplitude_m, rel=1e-3)
    assert after.vertices.dtype == before.vertices.dtype
    np.testing.assert_array_equal(after.faces, before.faces)


def test_a_change_is_smooth(dressed):
    """Neighbours move alike: lengths of edges change by far less than vertices move."""
    changed = change_rest_shape(dressed.outfit, 0.001, rng_for(0, "waves"))
    (before,), (after,) = dressed.outfit.garments, changed.garments
    edge = before.faces[:, :2]
    moved = after.vertices.astype(float) - before.vertices
    assert np.linalg.norm(moved[edge[:, 0]] - moved[edge[:, 1]], axis=1).max() < 0.0015


@pytest.mark.parametrize("number", [0, 1])
def test_an_unchanged_garment_is_not_away_from_itself(dressed, tmp_path, number):
    """Whichever attempt it was: to the bit, by the fast solver on one thread."""
    solver = cloth_solver(1)
    record = measure_outfit(tmp_path / "first", dressed, solver, settings=SETTINGS, number=number)
    count = len(dressed.outfit.garments[0].vertices)
    with PointCache(tmp_path / "first/Skirt.f32", count) as cache:
        first = cache.frames()
    same = replace(dressed, outfit=change_rest_shape(dressed.outfit, 0.0, rng_for(0, "waves")))
    again = simulate_again(same, solver, record["attempt"])
    np.testing.assert_array_equal(again["Skirt"], first)
    other = change_rest_shape(dressed.outfit, 0.001, rng_for(0, "waves"))
    changed = simulate_again(replace(dressed, outfit=other), solver, record["attempt"])
    assert np.abs(changed["Skirt"] - first).max() > 1e-5


def test_what_breaks_down_gives_nothing(dressed):
    def vanish(frame, vertices, followed, attempt):
        return vertices * np.nan if frame > attempt.lead_frames else vertices

    attempt = asdict(plan_attempt(0, SETTINGS, [300], dressed.motion.poses))
    assert simulate_again(dressed, Follower(vanish), attempt) == {}
