from dataclasses import replace

import numpy as np
import pytest

from drapeline.geometry.mesh import triangulate
from drapeline.outfits.fabrics import FABRICS
from drapeline.simulation.health import beneath_share
from sheet_toys import GAP_M, sheet

EDGE_M = 0.03


def test_cloth_falls_at_the_earths_pull(run):
    airless = replace(FABRICS["cotton"], drag_kg_m2_s=0)
    (fall,) = run([sheet(5.0, fabric=airless)], 16)
    pull = np.diff(fall[5:, :, 2].mean(axis=1), 2) * 30**2
    assert pull == pytest.approx(np.full(9, -9.81), rel=0.01)


def test_cloth_on_a_ball_rests_at_the_gap(run):
    (fall,) = run([sheet(0.115)], 40)
    distance = np.linalg.norm(fall[-1], axis=1) - 0.1
    top = np.linalg.norm(fall[-1, :, :2], axis=1) < 0.05
    assert np.median(distance[top]) == pytest.approx(GAP_M, abs=0.001)
    assert distance.min() > 0
    assert fall[-1, 0, 2] < 0.07  # its corner hangs down


def test_two_layers_keep_their_order_and_the_outer_pushes_the_inner(run):
    under, over = sheet(0.115, name="in"), sheet(0.13, name="out")
    inner, outer = run([under, over], 30, steps=16)
    assert beneath_share(outer[-1], inner[-1], triangulate(under.faces)) < 0.02
    assert beneath_share(inner[-1], outer[-1], triangulate(over.faces)) > 0.5
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
    (moved,) = run([sheet(1.0, shrink=np.full(169, 0.2))], 15)
    assert np.ptp(moved[-1, :, 0]) == pytest.approx(0.8 * 12 * EDGE_M, rel=0.05)


def test_two_runs_agree_to_the_byte(run):
    first, again = (run([sheet(0.115, rows=9)], 10)[0] for _ in range(2))
    np.testing.assert_array_equal(first, again)
