"""Means and deviations per vertex against those of numpy."""

import numpy as np

from drapeline.learning_data.vertex_moments import (
    BODY_STD_FLOOR_M,
    OFFSET_STD_FLOOR_M,
    body_statistics,
    offset_statistics,
)


def test_offsets_count_where_they_are_worn():
    rng = np.random.default_rng(0)
    offsets = rng.normal(0.02, 0.05, (40, 6, 3)).astype(np.float32)
    mask = rng.random((40, 6)) < 0.7
    mean, std = offset_statistics(zip(offsets, mask, strict=True))
    for vertex in range(6):
        worn = offsets[mask[:, vertex], vertex].astype(np.float64)
        np.testing.assert_allclose(mean[vertex], worn.mean(axis=0), atol=1e-7)
        np.testing.assert_allclose(std[vertex], worn.std(axis=0), atol=1e-7)
    assert mean.dtype == std.dtype == np.float32


def test_vertices_that_are_hardly_covered_take_the_median_deviation():
    rng = np.random.default_rng(1)
    offsets = rng.normal(0, [0.02, 0.04, 0.06], (50, 5, 3))
    mask = np.ones((50, 5), dtype=bool)
    mask[:, 3] = False
    mask[1:, 4] = False
    mean, std = offset_statistics(zip(offsets, mask, strict=True))
    np.testing.assert_allclose(std[3], np.median(std[:3], axis=0), rtol=1e-6)
    np.testing.assert_array_equal(std[4], std[3])
    assert not mean[3].any()
    np.testing.assert_allclose(mean[4], offsets[0, 4], rtol=1e-6)


def test_deviations_have_a_floor():
    still = np.full((10, 4, 3), 0.01)
    mean, std = offset_statistics((offsets, np.ones(4, dtype=bool)) for offsets in still)
    np.testing.assert_allclose(mean, 0.01)
    np.testing.assert_allclose(std, OFFSET_STD_FLOOR_M)
    mean, std = body_statistics(still)
    np.testing.assert_allclose(mean, 0.01)
    np.testing.assert_allclose(std, BODY_STD_FLOOR_M)


def test_bodies_have_their_mean_and_deviation():
    bodies = np.random.default_rng(2).normal(1.0, 0.1, (30, 7, 3)).astype(np.float32)
    mean, std = body_statistics(bodies)
    np.testing.assert_allclose(mean, bodies.mean(axis=0), atol=1e-6)
    np.testing.assert_allclose(std, bodies.std(axis=0), atol=1e-6)
