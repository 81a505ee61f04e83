from dataclasses import replace

import numpy as np
import pytest

from drapeline.outfits.fabrics import FABRICS
from toys.sheets import GAP_M, assert_floor_holds, beneath_share, sheet

EDGE_M = 0.03


def test_cloth_falls_at_the_earths_pull(run):
    airless = replace(FABRICS["cotton"], drag_kg_m2_s=0)
    (fall,) = run([sheet(5.0, fabric=airless)], 12)
    pull = np.diff(fall[:, :, 2].mean(axis=1), 2) * 30**2
    assert pull == pytest.approx(np.full(10, -9.81), rel=0.01)


def test_cloth_on_a_ball_rests_at_the_gap(run):
    (fall,) = run([sheet(0.115)], 40)
    distance = np.linalg.norm(fall[-1], axis=1) - 0.1
    top = np.linalg.norm(fall[-1, :, :2], axis=1) < 0.05
    # Coarse faces touch with their middles: vertices stand off by the sagitta of an edge as well.
    sagitta = EDGE_M**2 / (8 * 0.1)
    assert GAP_M - 0.001 < np.median(distance[top]) < GAP_M + 2 * sagitta
    assert distance.min() > 0
    assert fall[-1, 0, 2] < 0.07  # its corner hangs down


def test_cloth_lies_on_the_floor_and_rises_with_it(run):
    assert_floor_holds(run)


def test_two_layers_keep_their_order(run):
    under, over = sheet(0.115, name="in"), sheet(0.13, name="out")
    inner, outer = run([under, over], 30)
    assert beneath_share(outer[-1], inner[-1], under.faces) < 0.05  # a third, if it falls alone
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
    (moved,) = run([piece], 20, pin_weight=1.0)
    np.testing.assert_allclose(moved[-1, :13], piece.vertices[:13] + path(19), atol=1e-4)
    assert moved[-1, 13:, 2].max() < 1.0
    assert moved[-1, 13:, 1].mean() > 0.1


@pytest.mark.parametrize(("pin_weight", "weight"), [(0.9, 1), (1.0, 0.9)])
def test_a_softly_held_edge_gives_a_little(run, pin_weight, weight):
    piece = sheet(1.0, pin=first_row(weight))
    (moved,) = run([piece], 30, pin_weight=pin_weight)
    way = np.linalg.norm(moved[-1, :13] - piece.vertices[:13], axis=1)
    assert 1e-5 < way.max() < 0.02


def test_an_elastic_gathers(run):
    (moved,) = run([sheet(1.0, shrink=np.full(169, 0.2))], 15)
    assert np.ptp(moved[-1, :, 0]) == pytest.approx(0.8 * 12 * EDGE_M, rel=0.05)


def test_frames_beyond_blenders_usual_end_still_move(run):
    def path(frame):
        return np.array([0, 0, -0.001 * max(frame - 250, 0)])

    (moved,) = run([sheet(0.115, rows=7)], 265, path=path, steps=3)
    late = np.abs(np.diff(moved[251:, :, 2], axis=0)).max(axis=1)
    assert np.all(late > 1e-5)


def test_two_runs_agree(run):
    first, again = (run([sheet(0.115, rows=9)], 10)[0] for _ in range(2))
    np.testing.assert_array_equal(first, again)
