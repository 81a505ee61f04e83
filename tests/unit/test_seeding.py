"""Streams of random numbers."""

import numpy as np

from drapeline.seeding import rng_for


def test_streams_depend_on_seed_and_names_only():
    draw = rng_for(0, "shape", "00001").random(4)
    np.testing.assert_array_equal(draw, rng_for(0, "shape", "00001").random(4))
    for other in [(1, "shape", "00001"), (0, "pose", "00001"), (0, "shape", "00002"), (0, "shape")]:
        assert not np.allclose(draw, rng_for(*other).random(4))


def test_names_are_not_glued_together():
    assert rng_for(1, "ab", "c").random() != rng_for(1, "a", "bc").random()
