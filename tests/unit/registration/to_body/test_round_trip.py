"""Errors between a garment and what is rebuilt, on surfaces whose distances are known."""

import numpy as np
import pytest

from drapeline.registration.to_body.correspondence import Correspondence
from drapeline.registration.to_body.round_trip import round_trip, surface_distance


def sheet(n=11, step=0.02, height=0.0):
    x, y = np.meshgrid(np.arange(n) * step, np.arange(n) * step)
    vertices = np.stack([x.ravel(), y.ravel(), np.full(n * n, height)], -1)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = [[corner, corner + 1, corner + n + 1], [corner, corner + n + 1, corner + n]]
    return vertices, np.concatenate([np.stack(f, -1) for f in faces])


def identity(count, mask=None):
    mask = np.ones(count, dtype=bool) if mask is None else mask
    corner = np.repeat(np.arange(count)[:, None], 3, 1).astype(np.int32)
    bary = np.tile(np.array([1, 0, 0], np.float32), (count, 1))
    return Correspondence(mask, corner, bary, 0, 0)


def test_parallel_sheets_are_as_far_apart_as_they_are():
    low, faces = sheet()
    high, _ = sheet(height=0.03)
    distance, angle, area = surface_distance(low, faces, high, faces)
    np.testing.assert_allclose(distance, 0.03, atol=1e-6)
    np.testing.assert_allclose(angle, 0, atol=0.1)
    assert area.sum() == pytest.approx(0.04)


def test_a_tilted_sheet_shows_its_angle():
    flat, faces = sheet()
    tilted = flat @ np.array([[1, 0, 0], [0, np.cos(0.3), np.sin(0.3)], [0, 0, 1.0]])
    _, angle, _ = surface_distance(flat, faces, tilted, faces)
    np.testing.assert_allclose(angle, np.degrees(0.3), atol=0.1)


def test_the_same_mesh_loses_nothing():
    vertices, faces = sheet(height=0.1)
    body, _ = sheet()
    found = {m.metric: m for m in round_trip(vertices, faces, body, faces, identity(len(body)))}
    for name in ("garment_to_rebuilt_max_mm", "rebuilt_to_garment_max_mm", "area_lost_percent"):
        assert found[name].value == pytest.approx(0, abs=1e-3)
    assert found["normal_error_deg"].value < 0.1
    assert {found[n].unit for n in ("garment_to_rebuilt_mean_mm", "normal_error_deg")} == {
        "mm",
        "deg",
    }


def test_a_missing_half_is_lost_area_one_way_only():
    vertices, faces = sheet()
    match = identity(len(vertices), vertices[:, 0] < 0.101)
    found = {m.metric: m.value for m in round_trip(vertices, faces, vertices, faces, match)}
    assert found["area_lost_percent"] == pytest.approx(45, abs=6)
    assert found["garment_to_rebuilt_max_mm"] == pytest.approx(100, abs=10)
    assert found["rebuilt_to_garment_max_mm"] == pytest.approx(0, abs=1e-3)


def test_faces_count_by_their_area():
    """Ever wider columns, of which the last ones are lost."""
    vertices, faces = sheet()
    vertices[:, 0] = 5 * vertices[:, 0] ** 2
    match = identity(len(vertices), np.arange(121) % 11 < 8)
    found = {m.metric: m.value for m in round_trip(vertices, faces, vertices, faces, match)}
    rebuilt = faces[match.mask[faces].all(axis=1)]
    distance, _, area = surface_distance(vertices, faces, vertices, rebuilt)
    by_area = 1000 * (distance * area).sum() / area.sum()
    assert by_area > 1.3 * 1000 * distance.mean()
    assert found["garment_to_rebuilt_mean_mm"] == pytest.approx(by_area)


def test_holes_and_islands_of_the_rebuilt_mesh_are_counted():
    vertices, faces = sheet()
    mask = np.ones(len(vertices), dtype=bool)
    mask[5 * 11 + 5] = False
    found = {
        m.metric: m.value for m in round_trip(vertices, faces, vertices, faces, identity(121, mask))
    }
    assert (found["holes_after"], found["islands_after"]) == (1, 0)
    mask = np.ones(121, dtype=bool)
    mask[3::11] = False
    found = {
        m.metric: m.value for m in round_trip(vertices, faces, vertices, faces, identity(121, mask))
    }
    assert found["islands_after"] == 1
