"""Shapes of bodies."""

import numpy as np

from drapeline.bodies.sampling import sample_shape
from drapeline.seeding import rng_for


def test_shapes_are_uniform_and_reproducible():
    shapes = np.array([sample_shape(rng_for(0, "shape", i), 3.0) for i in range(2000)])
    assert shapes.shape == (2000, 10)
    assert np.abs(shapes).max() <= 3
    np.testing.assert_allclose(shapes.mean(axis=0), 0, atol=0.2)
    np.testing.assert_allclose(shapes.std(axis=0), 3 / np.sqrt(3), rtol=0.05)
    np.testing.assert_array_equal(shapes[5], sample_shape(rng_for(0, "shape", 5), 3.0))
