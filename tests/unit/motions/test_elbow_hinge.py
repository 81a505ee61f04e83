import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.motions.elbow_hinge import measured_twists
from toys.motion_files import random_turns

SIGNS = {"left": 1.0, "right": -1.0}


def arm(side, roll_deg, *, flexion_deg=(0.0, 40.0, 90.0, 130.0), wobble_deg=0.0):
    """Upper arm anywhere and forearm bent forward, on a rest pose rolled by an angle about +X."""
    rng = np.random.default_rng(0)
    flexion = np.radians(flexion_deg)
    upper = random_turns(rng, (len(flexion),), 2.0)
    bend = Rotation.from_rotvec(flexion[:, None] * [0.0, -SIGNS[side], 0.0])
    wobble = Rotation.from_rotvec(rng.normal(scale=np.radians(wobble_deg), size=(len(flexion), 3)))
    roll = Rotation.from_euler("X", roll_deg, degrees=True).as_matrix()
    forearm = upper @ (bend * wobble).as_matrix()
    return upper @ roll, forearm @ roll


@pytest.mark.parametrize("roll_deg", [0.0, 30.0, -40.0, 90.0, 170.0])
def test_the_roll_of_a_rest_pose_is_undone(roll_deg):
    twists = measured_twists({side: arm(side, roll_deg) for side in SIGNS})
    # Twists are about the limbs' own directions, +X on the left and -X on the right.
    expected = {
        f"{side}_{part}": sign * roll_deg
        for side, sign in SIGNS.items()
        for part in ("shoulder", "elbow")
    }
    assert twists == pytest.approx(expected, abs=1e-6)


def test_an_arm_that_stays_straight_mirrors_the_other():
    straight = arm("right", 30.0, flexion_deg=(0.0, 3.0, 5.0))
    twists = measured_twists({"left": arm("left", 30.0), "right": straight})
    assert twists["right_shoulder"] == pytest.approx(-30.0)
    twists = measured_twists(
        {"left": arm("left", 30.0, flexion_deg=(0.0, 4.0)), "right": arm("right", -10.0)}
    )
    assert twists["left_elbow"] == pytest.approx(-10.0)


def test_nothing_is_measured_where_no_arm_bends_about_an_axis():
    straight = {side: arm(side, 30.0, flexion_deg=(0.0, 2.0)) for side in SIGNS}
    assert measured_twists(straight) == {}
    rng = np.random.default_rng(1)
    anyhow = {
        side: (random_turns(rng, (300,), 2.0), random_turns(rng, (300,), 2.0)) for side in SIGNS
    }
    assert measured_twists(anyhow) == {}


def test_an_elbow_that_is_not_quite_a_hinge_has_its_mean_axis():
    flexion = np.linspace(0, 120, 200)
    arms = {side: arm(side, 30.0, flexion_deg=flexion, wobble_deg=8.0) for side in SIGNS}
    twists = measured_twists(arms)
    assert twists["left_shoulder"] == pytest.approx(30.0, abs=2.0)
    assert twists["right_shoulder"] == pytest.approx(-30.0, abs=2.0)
