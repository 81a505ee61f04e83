import numpy as np
import pytest
import warp as wp

from drapeline.frames import JOINT_NAMES
from drapeline.geometry.point_cache import PointCache, write_point_cache
from drapeline.geometry.warp_mesh import start_warp
from drapeline.simulation.collider import MovingBody
from drapeline.xpbd.body_contact import BodySurface, Planes, stay_off_body, touch_body

THIGH, PALM = 0, 4


@pytest.fixture
def anchors(tmp_path, parallel):
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
            surface = BodySurface(body, [np.float32([[0, 0, 0.005]])], parallel=parallel)
            surface.move_to(body.frame(1))
            surface.move_to(body.frame(1))
        clock = wp.array(np.float32([0, 0]), dtype=float)
        strains = wp.array(np.float32([strain]), dtype=float)
        for height in heights:
            place = wp.array(np.float32([[0.01, 0.02, height]]), dtype=wp.vec3)
            reaches = {"home_reach_m": 0.012, "reach_m": 0.025}
            surface.find_anchors(place, strains, clock, **reaches, gap_m=0.004, slack_m=0.002)
        surface.find_clearance(0.045)
        face = surface.planes.anchor.numpy()[0]
        find.clearance = surface.planes.clearance.numpy()[0]
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
    np.testing.assert_allclose(anchors.clearance, [0.04, 0.04], atol=1e-6)
    anchors([0.2])
    assert anchors.clearance.min() > 1


def test_the_place_that_cloth_keeps_to_moves_with_the_body(tmp_path, parallel):
    start_warp()
    square = np.float32([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) / 10
    write_point_cache(tmp_path / "body.pc2", [square, square + np.float32([0, 0, 0.1])])
    segments = np.full(4, JOINT_NAMES.index("left_hip"))
    with PointCache(tmp_path / "body.pc2") as cache:
        body = MovingBody(cache, np.int32([[0, 1, 2], [0, 2, 3]]), segments)
        surface = BodySurface(body, [np.float32([[0.01, 0.02, 0.005]])], parallel=parallel)
    reaches = {"home_reach_m": 0.012, "reach_m": 0.025}
    strain = wp.array(np.float32([1]), dtype=float)
    for frame, time, height, ends in (
        (0, 0.0, 0.005, (0, 0)),
        (1, 0.0, 0.005, (0, 0.1)),
        (None, 0.5, 0.055, (0, 0.1)),
    ):
        if frame is not None:
            surface.move_to(square + np.float32([0, 0, 0.1 * frame]))
        clock = wp.array(np.float32([time, time]), dtype=float)
        place = vectors([0.01, 0.02, height])
        surface.find_anchors(place, strain, clock, **reaches, gap_m=0.004, slack_m=0.002)
        found = [a.numpy()[0, 2] for a in (surface.planes.from_place, surface.planes.to_place)]
        np.testing.assert_allclose(found, ends, atol=1e-6)


def vectors(*rows):
    return wp.array(np.float32(rows), dtype=wp.vec3)


@pytest.fixture
def between():
    """Heights of vertices between a floor at 0 and a ceiling that leaves this room above it."""
    start_warp()

    def touch(heights, clearance_m, steps=20, *, stay=False):
        place = vectors(*([0, 0, height] for height in heights))
        before = wp.clone(place)
        count = len(heights)
        still = vectors(*[[0, 0, 0]] * count)
        planes = Planes()
        planes.anchor = wp.zeros(count, dtype=int)
        planes.from_place, planes.to_place = still, still
        planes.from_normal = planes.to_normal = vectors(*[[0, 0, 1]] * count)
        planes.clearance = wp.array(np.full((count, 2), clearance_m, np.float32), dtype=wp.vec2)
        clock, friction = wp.zeros(2, dtype=float), wp.zeros(count, dtype=float)
        touching = [] if stay else [still, 0.004, 3e-4, 2e-5, friction]
        for _ in range(steps):
            wp.launch(
                stay_off_body if stay else touch_body,
                count,
                inputs=[planes, clock, *touching],
                outputs=[before, place],
            )
        np.testing.assert_allclose(place.numpy(), before.numpy(), atol=1e-6)  # without speed
        return place.numpy()[:, 2]

    return touch


@pytest.mark.parametrize(
    ("clearance_m", "least", "most"),
    [
        (0.006, 0.002, 0.003),  # a third for each of two sheets and for what is between them
        (0.012, 0.004, 0.006),
        (0.02, 0.004, 0.012),  # the gap, and room for another sheet
    ],
)
def test_cloth_leaves_room_for_a_sheet_on_the_other_side(between, clearance_m, least, most):
    heights = between(
        [-0.001, 0.0, 0.5 * (least + most), clearance_m, clearance_m + 0.001], clearance_m, 60
    )
    middle = 0.5 * (least + most)
    np.testing.assert_allclose(heights, [least, least, middle, most, most], atol=1e-6)


def test_where_nothing_faces_it_cloth_keeps_the_gap_alone(between):
    np.testing.assert_allclose(between([0.001, 0.03], 1000.0), [0.004, 0.03], atol=1e-6)


@pytest.mark.parametrize(
    ("clearance_m", "heights"), [(1000.0, [0.001, 0.001, 0.03]), (0.02, [-0.002, 0.0, 0.03])]
)
def test_cloth_that_was_kept_apart_stays_off_the_body_where_nothing_faces_it(
    between, clearance_m, heights
):
    found = between([-0.002, 0.0, 0.03], clearance_m, 1, stay=True)
    np.testing.assert_allclose(found, heights, atol=1e-6)
