from dataclasses import replace

import numpy as np
import pytest
import trimesh

from drapeline.blender.cloth import ClothPiece, Solver, simulate_cloth
from drapeline.blender.fabric_units import cloth_parameters
from drapeline.geometry.mesh import triangulate
from drapeline.geometry.point_cache import write_point_cache
from drapeline.outfits.fabrics import FABRICS
from drapeline.simulation.health import beneath_share

EDGE_M = 0.03
GAP_M = 0.004


def sheet(height, rows=13, name="sheet", **changes):
    x = (np.arange(rows) - (rows - 1) / 2) * EDGE_M
    points = np.stack([*np.meshgrid(x, x, indexing="ij"), np.full((rows, rows), height)], -1)
    grid = np.arange(rows * rows).reshape(rows, rows)
    faces = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], -1)
    count = rows * rows
    fields = {
        "parameters": cloth_parameters(FABRICS["cotton"], EDGE_M),
        "pin": np.zeros(count),
        "shrink": np.zeros(count),
    }
    return ClothPiece(
        name, points.reshape(-1, 3).astype(np.float32), faces.reshape(-1, 4), **fields | changes
    )


def run(tmp_path, pieces, frames, path=lambda frame: np.zeros(3), radius=0.1, **changes):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    body = np.asarray(ball.vertices, dtype=np.float32)
    cache = tmp_path / "body.pc2"
    write_point_cache(cache, [body + path(k) for k in range(frames)])
    half = GAP_M / 2
    solver = Solver(**{"steps": 8, "body_distance_m": half, "layer_distance_m": half} | changes)
    found = simulate_cloth(pieces, body + path(0), ball.faces, cache, frames=frames, solver=solver)
    return [np.stack(cloth) for cloth in zip(*found, strict=True)]


def test_cloth_falls_at_the_earths_pull(tmp_path):
    airless = cloth_parameters(replace(FABRICS["cotton"], drag_kg_m2_s=0), EDGE_M)
    (fall,) = run(tmp_path, [sheet(5.0, parameters=airless)], 12)
    pull = np.diff(fall[:, :, 2].mean(axis=1), 2) * 30**2
    assert pull == pytest.approx(np.full(10, -9.81), rel=0.01)


def test_cloth_on_a_ball_rests_at_the_gap(tmp_path):
    (fall,) = run(tmp_path, [sheet(0.115)], 40)
    distance = np.linalg.norm(fall[-1], axis=1) - 0.1
    top = np.linalg.norm(fall[-1, :, :2], axis=1) < 0.05
    # Coarse faces touch with their middles: vertices stand off by the sagitta of an edge as well.
    sagitta = EDGE_M**2 / (8 * 0.1)
    assert GAP_M - 0.001 < np.median(distance[top]) < GAP_M + 2 * sagitta
    assert distance.min() > 0
    assert fall[-1, 0, 2] < 0.07  # its corner hangs down


def test_two_layers_keep_their_order(tmp_path):
    under, over = sheet(0.115, name="in"), sheet(0.13, name="out")
    inner, outer = run(tmp_path, [under, over], 30)
    assert beneath_share(outer[-1], inner[-1], triangulate(under.faces)) == 0
    assert beneath_share(inner[-1], outer[-1], triangulate(over.faces)) > 0.5
    assert np.linalg.norm(outer[-1], axis=1).min() > 0.1 + 1.5 * GAP_M


def test_a_held_edge_follows_its_cache_and_the_rest_follows_the_edge(tmp_path):
    held = np.zeros(169)
    held[:13] = 1
    piece = sheet(1.0)
    cache = tmp_path / "pin.pc2"
    shift = np.array([0, 0.01, 0])
    write_point_cache(cache, [piece.vertices + k * shift for k in range(20)])
    (moved,) = run(tmp_path, [sheet(1.0, pin=held, pin_cache=cache)], 20)
    np.testing.assert_allclose(moved[-1, :13], piece.vertices[:13] + 19 * shift, atol=1e-4)
    assert moved[-1, 13:, 2].max() < 1.0
    assert moved[-1, 13:, 1].mean() > 0.1


def test_a_softly_held_edge_gives_a_little(tmp_path):
    held = np.zeros(169)
    held[:13] = 0.9
    piece = sheet(1.0)
    cache = tmp_path / "pin.pc2"
    write_point_cache(cache, [piece.vertices] * 30)
    (moved,) = run(tmp_path, [sheet(1.0, pin=held, pin_cache=cache)], 30)
    way = np.linalg.norm(moved[-1, :13] - piece.vertices[:13], axis=1)
    assert 1e-5 < way.max() < 0.02


def test_an_elastic_gathers(tmp_path):
    (moved,) = run(tmp_path, [sheet(1.0, shrink=np.full(169, 0.2))], 15)
    assert np.ptp(moved[-1, :, 0]) == pytest.approx(0.8 * 12 * EDGE_M, rel=0.05)


def test_frames_beyond_blenders_usual_end_still_move(tmp_path):
    def path(frame):
        return np.array([0, 0, -0.001 * max(frame - 250, 0)])

    (moved,) = run(tmp_path, [sheet(0.115, rows=7)], 265, path=path, steps=3)
    late = np.abs(np.diff(moved[251:, :, 2], axis=0)).max(axis=1)
    assert np.all(late > 1e-5)


def test_two_runs_agree(tmp_path):
    first, again = (run(tmp_path, [sheet(0.115, rows=9)], 10)[0] for _ in range(2))
    np.testing.assert_array_equal(first, again)
