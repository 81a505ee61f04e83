"""Bodies are set on the floor: contacts are held, flights fall, the world may lie anywhere."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.bodies.contact import GRAVITY_M_S2, MASS_SHARES, floor_contact
from drapeline.bodies.model import posed_vertices
from drapeline.bodies.motion_fit import fit_motion, lift_supports
from drapeline.bodies.overlap import measure_overlap
from drapeline.frames import FPS, JOINT_NAMES, REST_POSE

SHAPE = np.zeros(10)


def standing(body, frames, height_m=0.0):
    """Poses and path of a body that stands still, so high above the floor."""
    poses = np.tile(REST_POSE, (frames, 1))
    lowest = posed_vertices(body, SHAPE, poses[:1])[0][..., 2].min()
    return poses, np.tile([0.3, -0.2, height_m - lowest], (frames, 1))


def pendulum(body, frames=40):
    """Both legs swing, as rigid pendulums under a pelvis that stays where it is."""
    poses, path = standing(body, frames)
    for side in ("left", "right"):
        hip = 3 * JOINT_NAMES.index(f"{side}_hip")
        poses[:, hip] = 0.08 * np.sin(np.linspace(0, 2 * np.pi, frames))
    return poses, path


def jump(body):
    """A jump under two thirds of gravity, 30 cm high, from standing to standing."""
    fall = GRAVITY_M_S2 / 1.5
    frames = round(FPS * 2 * np.sqrt(2 * 0.3 / fall))
    times = np.arange(frames + 1) / FPS
    poses, path = standing(body, frames + 41)
    path[20 : 21 + frames, 2] += fall / 2 * times * (times[-1] - times)
    return poses, path


def measured(body, poses, path):
    return floor_contact(posed_vertices(body, SHAPE, poses)[0], path, body.segmentation)


def test_a_pendulum_under_a_fixed_pelvis_becomes_one_over_a_fixed_foot(toy_body):
    poses, path = pendulum(toy_body)
    assert measured(toy_body, poses, path).sliding_m_s > 0.05
    held = fit_motion(toy_body, SHAPE, poses, path)
    assert measured(toy_body, *held[:2]).sliding_m_s < 0.01
    assert held[2].contact.any(axis=1).all()


def test_a_body_that_hovers_is_put_down(toy_body):
    poses, path = standing(toy_body, 20, height_m=0.04)
    path[:, 2] += np.linspace(0, 0.02, 20)
    found = measured(toy_body, *fit_motion(toy_body, SHAPE, poses, path)[:2])
    assert found.hover_s == 0
    assert found.penetration_m < 0.004


def test_what_stands_already_stays_as_it_is(toy_body):
    poses, path = standing(toy_body, 12)
    held, place, _ = fit_motion(toy_body, SHAPE, poses, path)
    np.testing.assert_allclose(held, poses, atol=0.06)
    np.testing.assert_allclose(place, path, atol=0.01)


def test_flights_follow_gravity(toy_body):
    poses, path = jump(toy_body)
    held, place, supports = fit_motion(toy_body, SHAPE, poses, path)
    air = np.flatnonzero(supports.flight)[1:-1]
    assert len(air) > 10
    vertices = posed_vertices(toy_body, SHAPE, held)[0] + place[:, None]
    parts = [vertices[:, toy_body.segmentation == part].mean(axis=1) for part in range(24)]
    mass = np.einsum("s,sna->na", MASS_SHARES, np.stack(parts))[:, 2]
    fall = np.diff(mass, 2)[air - 1] * FPS**2
    assert fall.mean() == pytest.approx(-GRAVITY_M_S2, rel=0.1)


def test_the_world_may_lie_anywhere(toy_body):
    poses, path = pendulum(toy_body, 16)
    held, place, supports = fit_motion(toy_body, SHAPE, poses, path)
    around = Rotation.from_rotvec([0, 0, 1.0])
    turned = poses.copy()
    turned[:, :3] = (around * Rotation.from_rotvec(poses[:, :3])).as_rotvec()
    moved = around.apply(path) + [3.0, -2.0, 0.0]
    again, there, same = fit_motion(toy_body, SHAPE, turned, moved)
    np.testing.assert_array_equal(same.contact, supports.contact)
    np.testing.assert_allclose(again[:, 3:], held[:, 3:], atol=1e-3)
    np.testing.assert_allclose(there, around.apply(place) + [3.0, -2.0, 0.0], atol=1e-3)


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_few_frames_are_enough(toy_body, frames):
    poses, path = standing(toy_body, frames, height_m=0.05)
    held, place, _ = fit_motion(toy_body, SHAPE, poses, path)
    lowest = (posed_vertices(toy_body, SHAPE, held)[0] + place[:, None])[..., 2].min(axis=1)
    np.testing.assert_allclose(lowest, 0, atol=0.004)


def test_thinner_bodies_are_lowered_but_in_flight(toy_body):
    poses, path = standing(toy_body, 9, height_m=0.01)
    flight = np.arange(9) > 6
    path[flight, 2] += 0.5
    vertices = posed_vertices(toy_body, SHAPE, poses)[0]
    lifted = lift_supports(vertices, path, flight)
    np.testing.assert_allclose(lifted - path, np.tile([0, 0, -0.01], (9, 1)), atol=1e-6)


def test_arms_keep_clear_of_the_trunk(toy_body):
    """Arms that hang within a body are raised until they are beside it; others stay."""
    poses, path = standing(toy_body, 6)
    depths = []
    for angle in (1.8, 0.4):
        for side, sign in (("left", -1), ("right", 1)):
            poses[:, 3 * JOINT_NAMES.index(f"{side}_shoulder") + 2] = sign * angle
        held, _, _ = fit_motion(toy_body, SHAPE, poses, path)
        turn = np.abs(held - poses)[:, 3 * JOINT_NAMES.index("left_shoulder") + 2]
        depths.append(turn.max())
    assert depths[0] > 0.1
    assert depths[1] < 0.01


def test_knees_are_bent_no_further_than_calves_on_thighs_allow(toy_body):
    poses, path = standing(toy_body, 6)
    for side in ("left", "right"):
        poses[:, 3 * JOINT_NAMES.index(f"{side}_hip")] = -1.2
        poses[:, 3 * JOINT_NAMES.index(f"{side}_knee")] = 2.75
    held, _, _ = fit_motion(toy_body, SHAPE, poses, path)
    everything = np.ones(len(toy_body.v_template), dtype=bool)
    asked, left = (
        measure_overlap(toy_body, posed_vertices(toy_body, SHAPE, given)[0], everything).share
        for given in (poses, held)
    )
    assert asked > 0.05
    assert left < 0.75 * asked
