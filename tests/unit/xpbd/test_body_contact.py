import numpy as np
import pytest
import warp as wp

from drapeline.frames import JOINT_NAMES
from drapeline.geometry.point_cache import PointCache, write_point_cache
from drapeline.geometry.warp_mesh import start_warp
from drapeline.simulation.collider import MovingBody
from drapeline.xpbd.body_contact import BodySurface, touch_body

THIGH, PALM = 0, 4


@pytest.fixture
def anchors(tmp_path):
    """A thigh's skin at height 0, a palm that faces it from 4 cm, and one vertex of trousers."""
    start_warp()
    square = np.float32([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) / 10
    far = np.float32([0, 0, 0.3])  # the palm at rest
    rest = np.concatenate([square, square[::-1] + far])
    now = np.concatenate([square, square[::-1] + np.float32([0, 0, 0.04])])
    write_point_cache(tmp_path / "body.pc2", [rest, now])
    faces = np.int32([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    segments = np.repeat([JOINT_NAMES.index("left_hip"), JOINT_NAMES.index("left_hand")], 4)

    def find(heights, strain=1.0):
        """Anchor, and kind of limb, of a vertex that goes through heights over the thigh."""
        with PointCache(tmp_path / "body.pc2") as cache:
            body = MovingBody(cache, faces, segments)
            surface = BodySurface(body, [np.float32([[0, 0, 0.005]])])
            surface.move_to(body.frame(1))
            surface.move_to(body.frame(1))
        clock = wp.array(np.float32([0, 0]), dtype=float, device="cpu")
        strains = wp.array(np.float32([strain]), dtype=float, device="cpu")
        for height in heights:
            place = wp.array(np.float32([[0.01, 0.02, height]]), dtype=wp.vec3, device="cpu")
            reaches = {"home_reach_m": 0.012, "reach_m": 0.025, "room_m": 0.045}
            surface.find_anchors(place, strains, clock, **reaches, gap_m=0.004, slack_m=0.002)
        face = surface.anchor.numpy()[0]
        find.room = surface.room.numpy()[0]
        return (None if face < 0 else faces[face][0]), surface.strange.numpy()[0]

    return find


def test_cloth_keeps_to_the_limb_it_is_worn_on(anchors):
    assert anchors([0.005]) == (THIGH, 0)
    assert anchors([-0.005]) == (THIGH, 0)


def test_cloth_away_from_it_touches_a_hand_and_no_longer_when_it_is_torn(anchors):
    assert anchors([0.030]) == (PALM, 2)
    assert anchors([0.030], strain=1.5) == (None, 0)


def test_what_is_within_a_hand_at_once_is_left_alone(anchors):
    assert anchors([0.045]) == (None, 0)


def test_what_a_hand_has_pushed_stays_before_it(anchors):
    assert anchors([0.030, 0.045]) == (PALM, 2)


def test_nothing_is_near_in_the_middle_of_nowhere(anchors):
    assert anchors([0.2]) == (None, 0)


def test_how_far_the_body_faces_itself(anchors):
    anchors([0.005])
    np.testing.assert_allclose(anchors.room, [0.04, 0.04], atol=1e-6)
    anchors([0.2])
    assert anchors.room.min() > 1


@pytest.mark.parametrize("start", [0.001, 0.0025, 0.005])
def test_cloth_between_two_parts_of_the_body_keeps_to_the_middle(start):
    start_warp()

    def vectors(*rows):
        return wp.array(np.float32(rows), dtype=wp.vec3, device="cpu")

    place, before = vectors([0, 0, start]), vectors([0, 0, start])
    up, still = vectors([0, 0, 1]), vectors([0, 0, 0])
    anchor = wp.zeros(1, dtype=int, device="cpu")
    room = wp.array(np.float32([[0.004, 0.004]]), dtype=wp.vec2, device="cpu")
    clock = wp.zeros(2, dtype=float, device="cpu")
    friction = wp.zeros(1, dtype=float, device="cpu")
    surface = [anchor, still, still, up, up, room, clock, still]
    for _ in range(10):
        wp.launch(
            touch_body, 1, inputs=[*surface, 0.004, friction], outputs=[before, place], device="cpu"
        )
    np.testing.assert_allclose(place.numpy(), [[0, 0, 0.002]], atol=1e-6)
    np.testing.assert_allclose(before.numpy(), [[0, 0, 0.002]], atol=1e-6)  # without speed
