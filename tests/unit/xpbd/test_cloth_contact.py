import numpy as np
import pytest
import warp as wp

from contact_toys import FAR, GAPS, MASS, OWN_GAP, RELEASE_M, after_contact
from drapeline.geometry.mesh import triangulate
from drapeline.geometry.warp_mesh import start_warp
from drapeline.seeding import rng_for
from drapeline.xpbd.cloth_contact import NearTriangles, touch_cloth
from sheet_toys import sheet

# The last vertex is over the middle of a triangle whose corners are the others.
CORNERS = np.array([[0.0, 0, 0], [0.03, 0, 0], [0, 0.03, 0]])


def touch(height, *, before=None, side=1, layer=0, room=FAR, friction=0.0, slid=0.0):
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
        room=room,
        friction=(friction,),
    )
    return *found, new


def past(place):
    """(3,) way from where the last vertex touched the triangle to the vertex."""
    return place[3] - place[:3].mean(axis=0)


@pytest.mark.parametrize(("layer", "room", "gap"), GAPS)
@pytest.mark.parametrize("side", [1, -1])
def test_what_came_too_close_is_moved_to_the_gap(layer, room, gap, side):
    place, _, new = touch(side * 0.001, before=side * 0.02, side=side, layer=layer, room=room)
    assert past(place)[2] == pytest.approx(side * gap, abs=1e-6)
    # Nothing from outside pushes.
    np.testing.assert_allclose(MASS @ (place - new), 0, atol=1e-7)


def test_what_has_passed_through_comes_back():
    place, *_ = touch(-0.002, before=0.01)
    assert past(place)[2] == pytest.approx(OWN_GAP, abs=1e-6)


@pytest.mark.parametrize(("height", "room"), [(0.0071, FAR), (0.0031, (0.009, 0.009))])
def test_what_is_beyond_the_gap_is_left(height, room):
    place, _, new = touch(height, before=0.02, room=room)
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


def slow_near(place, rest, triangles, layers, margin_m, free_m):
    """Triangles near to each vertex, one by one: {(vertex, triangle): side}."""
    quads = triangles.reshape(-1, 2, 3)
    boxes = np.array([[place[q].min((0, 1)), place[q].max((0, 1))] for q in quads])
    at_rest = [(rest[q].min((0, 1)), rest[q].max((0, 1))) for q in quads]
    found = {}
    for i, p in enumerate(place):
        for number, (a, b, c) in enumerate(triangles):
            low, high = boxes[number // 2]
            own = layers[i] == layers[a]
            start, end = at_rest[number // 2]
            free = max(free_m, 0.5005 * np.linalg.norm(end - start))
            if own and np.linalg.norm(rest[i] - (start + end) / 2) <= free:
                continue
            if (p < low - margin_m).any() or (p > high + margin_m).any():
                continue
            sides = np.stack([place[b] - place[a], place[c] - place[a]], axis=1)
            normal = np.cross(*sides.T)
            height = (p - place[a]) @ normal / np.linalg.norm(normal)
            u, v = np.linalg.lstsq(sides, p - place[a], rcond=None)[0]
            if abs(height) < margin_m and u > -0.4 and v > -0.4 and u + v < 1.4:
                found[i, number] = np.sign(height)
    return found


@pytest.mark.parametrize("together", [False, True])
def test_near_triangles_are_those_of_a_slow_search(together):
    start_warp()
    layers = np.repeat([0, 1], [81, 30]).astype(np.int32)
    one, two = sheet(0.0, rows=9, edge_m=0.02), sheet(0.006, rows=5, columns=6, edge_m=0.045)
    rest = np.concatenate([one.vertices, two.vertices])
    triangles = np.concatenate([triangulate(one.faces), 81 + triangulate(two.faces)])
    rng = rng_for(1, "crumple")
    place = (rest + rng.normal(0, 0.004, rest.shape)).astype(np.float32)
    place[:36, 2] += 0.004  # rows that are folded over others of the same sheet
    place[:36, 1] = place[72:36:-1, 1]
    near = NearTriangles(
        wp.array(rest.astype(np.float32), dtype=wp.vec3, device="cpu"),
        wp.array(triangles.astype(np.int32), dtype=wp.vec3i, device="cpu"),
        wp.array(layers, dtype=int, device="cpu"),
        2,
        together=together,
    )
    near.find(wp.array(place, dtype=wp.vec3, device="cpu"), margin_m=0.012, free_m=0.028)
    rows = zip(near.count.numpy(), near.near.numpy(), strict=True)
    found = {
        (i, abs(n) - 1): np.sign(n) for i, (count, row) in enumerate(rows) for n in row[:count]
    }
    assert near.count.numpy().max() < 24
    assert found == slow_near(place, rest, triangles, layers, 0.012, 0.028)
    own = [layers[i] == layers[triangles[number, 0]] for i, number in found]
    assert any(own)
    assert not all(own)
