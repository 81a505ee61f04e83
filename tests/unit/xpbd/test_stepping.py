from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from drapeline.geometry.mesh import edges, triangulate
from drapeline.outfits.fabrics import FABRICS
from drapeline.xpbd import system
from drapeline.xpbd.launches import BusyLaunch
from drapeline.xpbd.solver import XpbdCloth
from drapeline.xpbd.stepping import Numbers
from toys.sheets import GAP_M, assert_floor_holds, beneath_share, drop, far_away, sheet

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
    assert rise == pytest.approx(np.full(3, Numbers().release_m_s), rel=0.02)


def test_two_layers_keep_their_order_and_the_outer_pushes_the_inner(run):
    under, over = sheet(0.115, name="in"), sheet(0.13, name="out")
    inner, outer = run([under, over], 30, steps=16)
    assert beneath_share(outer[-1], inner[-1], under.faces) < 0.02
    assert beneath_share(inner[-1], outer[-1], over.faces) > 0.5
    assert np.linalg.norm(outer[-1], axis=1).min() > 0.1 + 1.5 * GAP_M


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
    assert lengths == pytest.approx(np.full(len(lengths), 0.8 * EDGE_M), rel=0.02)


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
    return partial(drop, tmp_path, XpbdCloth(device=device, together=True))


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
