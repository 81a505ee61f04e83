import numpy as np
import pytest
import warp as wp

from drapeline.xpbd.cloth_contact import touch_cloth
from toys.contacts import FAR, GAPS, MASS, OWN_GAP, RELEASE_M, after_contact

# The last vertex is over the middle of a triangle whose corners are the others.
CORNERS = np.array([[0.0, 0, 0], [0.03, 0, 0], [0, 0.03, 0]])


def touch(height, *, before=None, side=1, layer=0, clearance=FAR, friction=0.0, slid=0.0):
    """Places (4, 3) after a contact, those that count as before it, and those that it found.

    The vertex comes from the height `before`, and slides along x by `slid`.
    """
    middle = CORNERS.mean(axis=0)
    old = np.concatenate([CORNERS, [middle + [0, 0, height if before is None else before]]])
    new = np.concatenate([CORNERS, [middle + [slid, 0, height]]])
    near, layers = [0, 0, 0, side], [0, 0, 0, layer]
    found = after_contact(
        touch_cloth,
        near,
        [[0, 1, 2]],
        old,
        new,
        layers=layers,
        clearance=clearance,
        friction=(wp.array(np.full(4, friction, np.float32), dtype=float),),
    )
    return *found, new


def past(place):
    """(3,) way from where the last vertex touched the triangle to the vertex."""
    return place[3] - place[:3].mean(axis=0)


@pytest.mark.parametrize(("layer", "clearance", "gap"), GAPS)
@pytest.mark.parametrize("side", [1, -1])
def test_what_came_too_close_is_moved_to_the_gap(layer, clearance, gap, side):
    place, _, new = touch(
        side * 0.001, before=side * 0.02, side=side, layer=layer, clearance=clearance
    )
    assert past(place)[2] == pytest.approx(side * gap, abs=1e-6)
    # Nothing from outside pushes.
    np.testing.assert_allclose(MASS @ (place - new), 0, atol=1e-7)


def test_what_has_passed_through_comes_back():
    place, *_ = touch(-0.002, before=0.01)
    assert past(place)[2] == pytest.approx(OWN_GAP, abs=1e-6)


@pytest.mark.parametrize(("height", "clearance"), [(0.0071, FAR), (0.0031, (0.009, 0.009))])
def test_what_is_beyond_the_gap_is_left(height, clearance):
    place, _, new = touch(height, before=0.02, clearance=clearance)
    np.testing.assert_allclose(place, new, atol=1e-9)


def test_old_depth_goes_slowly_and_gives_no_speed():
    place, before, new = touch(0.001)
    assert past(place)[2] == pytest.approx(0.001 + RELEASE_M, abs=1e-6)
    np.testing.assert_allclose(place - before, 0, atol=1e-7)
    assert np.abs(place - new).max() > 1e-5


def test_friction_holds_a_share_of_the_push():
    # So little that the vertex stays over the middle of the triangle.
    slid, push = 1e-4, OWN_GAP - 0.001
    for friction, held in ((0.0, 0.0), (0.01, 0.01 * push), (0.5, slid)):
        place, *_ = touch(0.001, before=0.02, slid=slid, friction=friction)
        assert past(place)[0] == pytest.approx(slid - held, abs=2e-6)
