import numpy as np
import pytest

from drapeline.rendering.camera import look_at
from drapeline.rendering.coco import CocoDocument, run_lengths
from drapeline.seeding import rng_for


def test_run_lengths_give_the_mask_back():
    mask = rng_for(3, "mask").random((7, 5)) < 0.4
    counts = run_lengths(mask)
    values = np.arange(len(counts)) % 2
    np.testing.assert_array_equal(np.repeat(values, counts).reshape(5, 7).T, mask)


@pytest.mark.parametrize(
    ("mask", "counts"),
    [(np.zeros((2, 3), bool), [6]), (np.ones((2, 3), bool), [0, 6]), (np.eye(2) > 0, [0, 1, 2, 1])],
)
def test_run_lengths_begin_with_those_of_nothing(mask, counts):
    assert run_lengths(mask) == counts


def test_keypoints_are_hidden_behind_limbs_and_left_out_beyond_the_picture():
    """A wall 1 m before the camera over the left half of the picture."""
    camera = look_at(np.array([2.0, 0, 1]), np.array([0.0, 0, 1]), focal_px=20, size=(40, 20))
    segments, depth = np.zeros((20, 40), np.uint8), np.zeros((20, 40), np.float32)
    segments[:, :20], depth[:, :20] = 1, 1.0
    joints = np.tile([1.0, 0.0, 50.0], (24, 1))  # above the picture
    joints[0] = [0.9, -0.5, 1]  # a little behind the wall
    joints[1] = [0.5, -0.5, 1]  # far behind it
    joints[2] = [0.9, 0.5, 1]  # beside it
    document = CocoDocument("00001", ["Skirt"], ["Skirt", "Top"])
    document.add("a.png", segments, depth, camera, joints)
    [person] = document.finish()["annotations"]
    points = np.array(person["keypoints"]).reshape(24, 3)
    assert points[:3, 2].tolist() == [2, 1, 1]
    assert points[0, :2].tolist() == camera.project(joints[0])[0].round(2).tolist()
    assert not points[3:].any()
    assert person["num_keypoints"] == 3
    assert person["bbox"] == [0, 0, 20, 20]


def test_what_is_not_seen_has_no_annotation():
    camera = look_at(np.array([2.0, 0, 1]), np.array([0.0, 0, 1]), focal_px=20, size=(40, 20))
    document = CocoDocument("00001", ["Skirt"], ["Skirt", "Top"])
    nothing = np.zeros((20, 40))
    document.add("a.png", nothing.astype(np.uint8), nothing, camera, np.zeros((24, 3)))
    found = document.finish()
    assert found["annotations"] == []
    assert [one["name"] for one in found["categories"]] == ["person", "Skirt", "Top"]
