from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import warp as wp

from drapeline.geometry.crossings import Crossings
from drapeline.geometry.mesh import edges, triangulate
from drapeline.geometry.warp_mesh import start_warp
from drapeline.outfits.fabrics import FABRICS
from drapeline.simulation.collider import as_published
from drapeline.xpbd import system
from drapeline.xpbd.solver import XpbdCloth
from drapeline.xpbd.stepping import (
    BusyLaunch,
    Replay,
    XpbdSettings,
    add_speed,
    hold,
    predict,
    record,
    take_places,
    take_speed,
    tick,
)
from toys.sheets import (
    GAP_M,
    Held,
    assert_floor_holds,
    beneath_share,
    drop,
    far_away,
    sheet,
    still,
)


@wp.kernel
def _add_count(
    busy: wp.array[int],
    count: wp.array[int],
    factor: int,
    total: wp.array[int],
    seen: wp.array[int],
):
    i = busy[wp.tid()]
    total[i] = total[i] + factor * count[i]
    seen[wp.tid()] = i


@pytest.mark.processor_only
def test_those_with_a_count_are_launched_in_order_once_they_are_found():
    start_warp()
    count = wp.array(np.int32([0, 2, 0, 1, 3]), dtype=int)
    total = wp.zeros(5, dtype=int)
    seen = wp.full(5, -1, dtype=int)
    launch = BusyLaunch(_add_count, count, [count, 10], [total, seen])
    launch.launch()
    assert total.numpy().tolist() == [0] * 5
    launch.find()
    for _ in range(2):
        launch.launch()
    assert total.numpy().tolist() == [0, 40, 0, 20, 60]
    assert seen.numpy().tolist() == [1, 3, 4, -1, -1]
    count.assign(np.int32([1, 0, 0, 0, 0]))
    launch.find()
    launch.launch()
    assert total.numpy().tolist() == [10, 40, 0, 20, 60]
    count.zero_()
    launch.find()
    launch.launch()
    assert total.numpy().tolist() == [10, 40, 0, 20, 60]


def test_nothing_is_launched_for_nothing():
    start_warp()
    empty = wp.zeros(0, dtype=int)
    assert record(_add_count, 0, [empty, empty, 1], [empty, empty]) is None
    launch = BusyLaunch(_add_count, empty, [empty, 1], [empty, empty])
    launch.find()
    launch.launch()


def test_launches_are_recorded_once_and_made_in_order_each_time():
    start_warp()
    one, two = (wp.array(np.int32([n]), dtype=int) for n in (1, 2))
    busy, seen = wp.zeros(1, dtype=int), wp.zeros(1, dtype=int)
    calls = []

    def times(factor, source, total):
        calls.append(factor)
        wp.launch(_add_count, 1, [busy, source, factor, total, seen])

    replay = Replay([lambda: times(10, one, two), lambda: times(100, two, one)])
    assert not calls
    for expected in ((1 + 100 * 12, 2 + 10), (1 + 1200 + 100 * 12022, 12 + 10 * 1201)):
        replay()
        assert (one.numpy()[0], two.numpy()[0]) == expected
    assert calls == [10, 100]


def vectors(*rows):
    return wp.array(np.float32(rows), dtype=wp.vec3)


def weigh(*rows):
    """Places and inverse masses."""
    return wp.array(np.float32(rows), dtype=wp.vec4)


def numbers(*values):
    return wp.array(np.float32(values), dtype=float)


@pytest.fixture(autouse=True)
def _warp():
    start_warp()


def launch(kernel, count, *arrays):
    wp.launch(kernel, dim=count, inputs=list(arrays))


def test_a_particle_goes_by_its_speed_and_gravity_and_is_carried_without_gaining_speed():
    place, before, way = vectors([1, 2, 3]), vectors([0, 0, 0]), vectors([0, 0, 0])
    speed, weighed = vectors([1, 0, 0]), weigh([0, 0, 0, 7])
    launch(predict, 1, numbers(0.5), vectors([0, 0.2, 0]), 0.1, speed, way, before, place, weighed)
    np.testing.assert_allclose(before.numpy(), [[1, 2.2, 3]])
    launch(take_places, 1, weighed, place)
    assert weighed.numpy()[0, 3] == 7
    np.testing.assert_allclose(place.numpy(), [[1.05, 2.2, 3 - 0.5 * 0.0981]], rtol=1e-6)
    launch(take_speed, 1, way, before, place, 0.1, speed)
    np.testing.assert_allclose(speed.numpy(), [[0.5, 0, -0.5 * 0.981]], atol=1e-5)
    pushed = vectors(place.numpy()[0] + [0, 0, 0.02])
    launch(take_speed, 1, way, before, pushed, 0.1, speed)
    np.testing.assert_allclose(speed.numpy(), [[0.5, 0, 0.2 - 0.5 * 0.981]], atol=1e-5)
    launch(add_speed, 1, wp.vec3(0.0, 1.0, 0.0), speed)
    np.testing.assert_allclose(speed.numpy()[0, 1], 1, atol=1e-5)


def test_gravity_is_exact_however_short_the_steps_and_far_the_place():
    """A step of the way of a fall may be less than half of the last place of the position."""
    step_s, steps = 1e-4, 200
    place, before, way, speed = (vectors([v, 0, v]) for v in (50, 0, 0, 0))
    weighed = weigh([0, 0, 0, 1])
    for _ in range(steps):
        state = speed, way, before, place, weighed
        launch(predict, 1, numbers(1), vectors([0, 0, 0]), step_s, *state)
        launch(take_places, 1, weighed, place)
        launch(take_speed, 1, way, before, place, step_s, speed)
    np.testing.assert_allclose(speed.numpy()[0], [0, 0, -9.81 * step_s * steps], rtol=1e-4)


def test_a_held_vertex_is_pulled_a_share_of_the_way_to_where_it_is_held_now():
    weighed = weigh([0, 0, 0, 5], [9, 9, 9, 6])
    held = wp.array([1], dtype=int)
    start, end = vectors([0, 0, 0]), vectors([4, 0, 0])
    launch(hold, 1, held, numbers(0.5), start, end, numbers(0.25, 0.5), weighed)
    np.testing.assert_allclose(weighed.numpy(), [[0, 0, 0, 5], [5.5, 4.5, 4.5, 6]])


def test_the_clock_goes_from_0_to_1_and_begins_again():
    ticks, clock = wp.zeros(1, dtype=int), numbers(0, 0)
    shown = []
    for _ in range(5):
        launch(tick, 1, 4, ticks, clock)
        shown.append(clock.numpy().tolist())
    assert shown == [[0, 0.25], [0.25, 0.5], [0.5, 0.75], [0.75, 1], [0, 0.25]]


EDGE_M = 0.03


def test_cloth_falls_at_the_earths_pull(run):
    airless = replace(FABRICS["cotton"], drag_kg_m2_s=0)
    (fall,) = run([sheet(5.0, fabric=airless)], 16)
    pull = np.diff(fall[5:, :, 2].mean(axis=1), 2) * 30**2
    assert pull == pytest.approx(np.full(9, -9.81), rel=0.002)


@pytest.mark.parametrize("edge_m", [0.045, 0.1])
def test_large_faces_do_not_touch_their_own_corners(run, edge_m):
    airless = replace(FABRICS["cotton"], drag_kg_m2_s=0)
    (fall,) = run([sheet(5.0, edge_m=edge_m, fabric=airless)], 10)
    np.testing.assert_allclose(np.ptp(fall[..., 2], axis=1), 0, atol=1e-4)
    np.testing.assert_allclose(fall[-1, :, :2], fall[0, :, :2], atol=1e-4)


def test_cloth_on_a_ball_rests_at_the_gap(run):
    (fall,) = run([sheet(0.115)], 40)
    distance = np.linalg.norm(fall[-1], axis=1) - 0.1
    top = np.linalg.norm(fall[-1, :, :2], axis=1) < 0.05
    assert np.median(distance[top]) == pytest.approx(GAP_M, abs=0.001)
    assert distance.min() > 0
    assert fall[-1, 0, 2] < 0.07  # its corner hangs down


def test_cloth_far_from_the_body_is_found_before_a_fast_limb_has_passed(run):
    """At rest, it lies on no limb."""

    def path(frame):
        return np.array([0, 0, 0.12 * max(frame - 2, 0)])

    (lifted,) = run([sheet(0.3, rows=9)], 7, path=path)
    assert np.linalg.norm(lifted[-1] - path(6), axis=1).min() - 0.1 > 0.5 * GAP_M


def test_cloth_lies_on_the_floor_and_rises_with_it(run):
    assert_floor_holds(run)


@pytest.mark.parametrize("steps", [4, 9])
def test_old_depth_comes_out_as_fast_whatever_the_steps(run, steps):
    (lifted,) = run([sheet(0.0)], 4, path=far_away, floor_m=np.full(4, 0.2), steps=steps)
    rise = np.diff(lifted[:, :, 2].mean(axis=1)) * 30
    assert rise == pytest.approx(np.full(3, XpbdSettings().release_m_s), rel=0.02)


def test_two_layers_keep_their_order_and_the_outer_pushes_the_inner(run):
    under, over = sheet(0.115, name="in"), sheet(0.13, name="out")
    inner, outer = run([under, over], 30, steps=16)
    assert beneath_share(outer[-1], inner[-1], under.faces) < 0.02
    assert beneath_share(inner[-1], outer[-1], over.faces) > 0.5
    assert np.linalg.norm(outer[-1], axis=1).min() > 0.1 + 1.5 * GAP_M


def test_sheets_that_rounding_crosses_are_moved_apart(run):
    """Half precision has steps of 2 mm where the root joint is as far away as this."""
    root = np.float32([3.1, 2.2, 2.1])

    def held(piece, height):
        vertices = (piece.vertices + height(*piece.vertices.T)[:, None] * [0, 0, 1]).astype("f4")
        pins = Held(np.full(len(vertices), 0.5), vertices, still)
        return replace(piece, vertices=vertices, pins=pins)

    slope = held(sheet(0.0, rows=7, edge_m=0.02), lambda x, y, z: 0.3 * x + 0.2 * y)
    bowl = held(
        sheet(2e-4, rows=5, edge_m=0.019), lambda x, y, z: 0.3 * x + 0.2 * y + 2 * (x**2 + y**2)
    )

    def crossing(**far):
        cloths = run([slope, bowl], 4, steps=16, path=far_away, gap_m=1e-4, **far)
        seen = Crossings([slope.vertices, bowl.vertices], [slope.faces, bowl.faces])
        parts = zip(*cloths, strict=True)
        return [sum(seen.find([as_published(c - root) for c in part])[1]) for part in parts]

    assert min(crossing()) > 0
    assert max(crossing(root=root)[1:]) == 0


def test_a_fabric_slides_off_the_body_as_far_as_its_friction_lets_it(run):
    def beside(friction):
        fabric = replace(FABRICS["cotton"], skin_friction=friction, self_friction=friction)
        piece = sheet(0.115, rows=9, edge_m=0.02, fabric=fabric)
        shifted = piece.vertices + np.float32([0.04, 0, 0])
        (moved,) = run(
            [replace(piece, vertices=shifted, pins=Held(np.zeros(81), shifted, still))], 14
        )
        return moved[-1, :, 0].mean() - 0.04

    rough, smooth = beside(0.9), beside(0.05)
    assert smooth > 0.01
    assert rough < 0.6 * smooth


def first_row(weight):
    weights = np.zeros(169, dtype=np.float32)
    weights[:13] = weight
    return weights


def test_a_held_edge_follows_its_path_and_the_rest_follows_the_edge(run):
    def path(frame):
        return np.array([0, 0.01 * frame, 0])

    piece = sheet(1.0, pin=first_row(1), path=path)
    (moved,) = run([piece], 20)
    np.testing.assert_allclose(moved[-1, :13], piece.vertices[:13] + path(19), atol=5e-3)
    assert moved[-1, 13:, 2].max() < 1.0
    assert moved[-1, 13:, 1].mean() > 0.1


def test_an_elastic_gathers(run):
    """Its edges are as long as it asks for, whatever the sheet does as a whole."""
    piece = sheet(5.0, shrink=np.full(169, 0.2))
    (moved,) = run([piece], 15)
    ends = moved[-1][edges(piece.faces)]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    assert np.percentile(lengths, 95) < 1.02 * 0.8 * EDGE_M
    assert lengths.mean() == pytest.approx(0.8 * EDGE_M, rel=0.02)


def test_two_runs_agree_to_the_byte(run):
    first, again = (run([sheet(0.115, rows=9)], 10)[0] for _ in range(2))
    np.testing.assert_array_equal(first, again)


def test_the_order_of_constraints_hardly_matters(run, monkeypatch):
    """Colours against one after another: until folds form, which the least difference decides."""
    (coloured,) = run([sheet(0.115)], 20, steps=14)
    monkeypatch.setattr(system, "colour_constraints", lambda rows, count: np.arange(len(rows)))
    (lexical,) = run([sheet(0.115)], 20, steps=14)
    way = np.linalg.norm(coloured[3] - coloured[0], axis=1).mean()
    away = np.linalg.norm(coloured[3] - lexical[3], axis=1).mean()
    assert 0 < away < 0.03 * way
    # Folds differ afterwards, and the sheet as a whole does not.
    np.testing.assert_allclose(coloured[-1].mean(axis=0), lexical[-1].mean(axis=0), atol=0.005)


def test_a_mirrored_sheet_falls_as_the_mirror_image(run):
    """To a centimetre on average: the order of constraints is not mirrored, and folds differ."""

    def shifted(side):
        piece = sheet(0.115, edge_m=0.02)
        return replace(piece, vertices=piece.vertices + np.float32([side * 0.03, 0.01, 0]))

    (right,), (left,) = (run([shifted(side)], 20, steps=14) for side in (1, -1))
    image = left[-1].reshape(13, 13, 3)[::-1].reshape(-1, 3) * [-1, 1, 1]
    assert np.linalg.norm(right[-1] - image, axis=1).mean() < 0.01
    np.testing.assert_allclose(right[-1].mean(axis=0), image.mean(axis=0), atol=0.003)


def test_cloth_rides_on_a_body_that_moves(run):
    def path(frame):
        return np.array([0.01 * max(frame - 15, 0), 0, 0])

    (moved,) = run([sheet(0.115)], 40, path=path, steps=14)
    middle = 84
    way = moved[-1, middle] - moved[15, middle]
    assert way[0] == pytest.approx(path(39)[0], abs=0.02)


def test_triangles_are_simulated_as_well(run):
    piece = sheet(0.115)
    (fall,) = run([replace(piece, faces=triangulate(piece.faces))], 40)
    assert np.linalg.norm(fall[-1], axis=1).min() > 0.1
    assert fall[-1, 0, 2] < 0.07


@pytest.fixture
def run_at_once(tmp_path, device):
    """As `run`, but constraints of a colour and contacts of a kind act at once."""
    return partial(drop, tmp_path, XpbdCloth(device=device, parallel=True))


def test_constraints_at_once_are_those_in_turn(tmp_path, run_at_once):
    """Those of a colour share no vertex; without contact nothing else differs."""
    piece = sheet(1.0, pin=first_row(1), path=lambda frame: np.array([0, 0.01 * frame, 0]))
    (in_turn,), (at_once,) = drop(tmp_path, XpbdCloth(), [piece], 12), run_at_once([piece], 12)
    assert np.abs(in_turn[-1] - piece.vertices).max() > 0.1
    np.testing.assert_allclose(at_once, in_turn, atol=1e-4)


def test_contacts_at_once_hold_layers_on_a_ball(run_at_once):
    under, over = sheet(0.115, name="in"), sheet(0.13, name="out")
    inner, outer = (cloth[-1] for cloth in run_at_once([under, over], 30, steps=16))
    assert np.linalg.norm(inner, axis=1).min() > 0.1
    for layer, cloth in enumerate((inner, outer), start=1):
        distance = np.linalg.norm(cloth, axis=1) - 0.1
        top = np.linalg.norm(cloth[:, :2], axis=1) < 0.05
        assert np.median(distance[top]) == pytest.approx(layer * GAP_M, abs=0.001)
    assert beneath_share(inner, outer, over.faces) > 0.5


@pytest.mark.processor_only
def test_contacts_at_once_have_no_order(run_at_once, monkeypatch):
    pieces = [sheet(0.115, name="in"), sheet(0.13, name="out")]
    cloths = run_at_once(pieces, 12)

    def find_backwards(launch):
        busy = np.flatnonzero(launch._count.numpy())[::-1]
        launch._numbers.numpy()[: len(busy)] = busy
        launch._launch.set_dim(len(busy))

    monkeypatch.setattr(BusyLaunch, "find", find_backwards)
    for cloth, again in zip(cloths, run_at_once(pieces, 12), strict=True):
        np.testing.assert_array_equal(again, cloth)
