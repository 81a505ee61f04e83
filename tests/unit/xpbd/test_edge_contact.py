import numpy as np
import pytest

from drapeline.xpbd.edge_contact import touch_edges
from toys.contacts import FAR, GAPS, MASS, RELEASE_M, after_contact


def touch(height, *, before=None, side=1, layer=0, room=FAR, shift=0.0):
    """Places (4, 3) after a contact, those that count as before it, and those that it found.

    An edge along y, shifted along x, crosses another along x at a height; it was at the height
    `before`. Seen along the normal of the kernel, d x e, the first edge is at `side`.
    """
    new = np.array([[-0.01, 0, 0], [0.02, 0, 0], [shift, -0.02, height], [shift, 0.01, height]])
    old = new.copy()
    old[2:, 2] = height if before is None else before
    near, layers = [2 * side, 0], [0, 0, layer, layer]
    edges = [[0, 1], [2, 3]]
    return *after_contact(touch_edges, near, edges, old, new, layers=layers, room=room), new


def rise(place, at=(1 / 3, 2 / 3)):
    """Height of the second edge over the first, where they crossed."""
    under = place[0] + at[0] * (place[1] - place[0])
    return (place[2] + at[1] * (place[3] - place[2]) - under)[2]


@pytest.mark.parametrize(("layer", "room", "gap"), GAPS)
@pytest.mark.parametrize("side", [1, -1])
def test_edges_that_came_too_close_are_moved_to_the_gap(layer, room, gap, side):
    # The first is below the second, so along d x e, which points up, it is on the negative side.
    place, _, new = touch(side * 0.001, before=side * 0.02, side=-side, layer=layer, room=room)
    assert rise(place) == pytest.approx(side * gap, abs=1e-6)
    np.testing.assert_allclose(MASS @ (place - new), 0, atol=1e-7)


@pytest.mark.parametrize(
    ("height", "shift", "room"),
    [(0.0071, 0.0, FAR), (0.001, 0.021, FAR), (0.0031, 0.0, (0.009, 0.009))],
)
def test_edges_that_do_not_meet_are_left(height, shift, room):
    place, _, new = touch(height, before=0.02, side=-1, shift=shift, room=room)
    np.testing.assert_allclose(place, new, atol=1e-9)


def test_old_depth_goes_slowly_and_gives_no_speed():
    place, before, _ = touch(0.001, side=-1)
    assert rise(place) == pytest.approx(0.001 + RELEASE_M, abs=1e-6)
    np.testing.assert_allclose((place - before)[:, 2], 0, atol=1e-7)
