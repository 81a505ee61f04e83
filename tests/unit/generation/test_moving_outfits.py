"""Clothes on a toy body in motion, by one call, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from drapeline.bodies.animation import leg_length_m
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.generation.moving_outfits import simulate
from drapeline.geometry.mesh import Mesh
from drapeline.motions.motion import Motion, interpolate
from toys.bounds import NO_BOUNDS
from toys.smplicit import tube

SETTINGS = {"steps_min": 6, "steps_max": 6, "pose_frames": 2, "settle_frames": 0, "attempts": 1}

NOTHING = Motion(np.zeros((0, 72)), np.zeros((0, 3)), 30.0, "", "", "", "nothing")


@pytest.fixture(scope="module")
def motion():
    poses = np.tile(REST_POSE, (4, 1))
    poses[:, 3 * 1] = np.linspace(0, -0.3, 4)  # the left leg rises
    path = np.zeros((4, 3))
    path[:, 0] = 0.01 * np.arange(4)
    return Motion(poses, path, 30.0, "", "", "", "kick")


@pytest.fixture(scope="module")
def skirt():
    return tube(0.27, -0.5, 0.02, around=48, rings=14)


def move(skirt, motion, body, **changes):
    return simulate(
        {"Skirt": skirt}, motion, body, settings=SETTINGS, bounds=NO_BOUNDS.plain(), **changes
    )


def test_cloth_and_body_move_together(toy_body, motion, skirt):
    worn = move(skirt, motion, toy_body, edge_length_m=0.01)
    assert (worn.gender, worn.poses.shape, worn.trans.shape) == ("female", (4, 72), (4, 3))
    assert len(worn.body) == len(worn.garments["Skirt"].frames) == 4
    assert worn.body[0].vertices.shape == (len(toy_body.v_template), 3)
    stride = 0.01 * leg_length_m(toy_body, worn.shape) / motion.reference_leg_length_m
    np.testing.assert_allclose(np.diff(worn.trans[:, 0]), stride, rtol=0.1)
    sheet = worn.garments["Skirt"]
    assert sheet.rest.faces.tolist() == sheet.frames[-1].faces.tolist() == skirt.faces.tolist()
    # It stays on: the waist is held, and the hem is still about the legs.
    change = sheet.frames[-1].vertices - skirt.vertices
    assert np.linalg.norm(change[skirt.vertices[:, 2] > 0.01], axis=1).max() < 0.02
    assert np.linalg.norm(change, axis=1).max() < 0.3
    assert np.linalg.norm(change[skirt.vertices[:, 2] < -0.4], axis=1).max() > 1e-3


def test_the_same_arguments_give_the_same_frames(toy_body, motion, skirt):
    one, other = (move(skirt, motion, toy_body, edge_length_m=0.06) for _ in range(2))
    assert len(one.garments["Skirt"].rest.vertices) < 0.6 * len(skirt.vertices)  # coarser
    for frame, again in zip(*(w.garments["Skirt"].frames for w in (one, other)), strict=True):
        assert (frame.vertices == again.vertices).all()


def test_a_motion_of_another_rate_takes_as_long_as_it_does(toy_body, motion, skirt):
    twice = interpolate(motion.poses, motion.trans, np.arange(4) / 30, np.arange(7) / 60)
    worn = move(skirt, replace(motion, poses=twice[0], trans=twice[1], fps=60.0), toy_body)
    assert len(worn.poses) == 4
    np.testing.assert_allclose(worn.poses, move(skirt, motion, toy_body).poses, atol=1e-5)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"outfit": "Cape"}, "outfit: 'Cape', expected one of .*Dress"),
        ({"outfit": {"Cape": Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))}}, "'Cape', expected"),
        ({"gender": "none"}, "gender: 'none', expected one of female, male"),
        ({"solver": "fem"}, "solver: 'fem', expected one of blender, xpbd"),
        ({"shape": [0.0] * 9}, "shape: .*expected 10 finite numbers"),
        ({"motion": NOTHING}, "holds 0 frames"),
        ({"settings": {"step_min": 3}}, "did you mean steps_min"),
    ],
)
def test_what_cannot_be_simulated_is_refused(toy_body, motion, skirt, changes, sentence):
    given = {"outfit": {"Skirt": skirt}, "motion": motion, "body": toy_body, **changes}
    with pytest.raises(InputError, match=sentence):
        simulate(**given)
