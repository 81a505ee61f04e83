"""Rows that linear models learn from, their mirror images, and rows that errors are of."""

import numpy as np
import pytest

from drapeline.learning_data import training_rows
from drapeline.learning_data.training_rows import (
    linear_rows,
    mirror_batch,
    rows_like,
    with_mirror_images,
)
from toys.gcvae import ToyGarments, tube_mirror


def test_rows_are_those_of_the_split_up_to_a_number_and_then_drawn(monkeypatch):
    garments = ToyGarments()
    every = garments.rows("train")
    np.testing.assert_array_equal(linear_rows(garments, "train", seed=0), every)
    monkeypatch.setattr(training_rows, "LINEAR_ROWS_MAX", 10)
    drawn, others = (linear_rows(garments, "train", seed) for seed in (0, 1))
    assert len(drawn) == len(others) == 10
    assert (np.diff(drawn) > 0).all()
    assert set(drawn) < set(every)
    assert drawn.tolist() != others.tolist()


def test_images_follow_their_rows_and_an_uneven_body_has_none():
    garments, mirror = ToyGarments(), tube_mirror()
    rows = np.array([2, 5])
    batch, image = with_mirror_images(garments, rows, mirror)
    np.testing.assert_array_equal(batch["offsets"], garments.offsets[rows])
    np.testing.assert_array_equal(image["mask"], garments.mask[rows][:, mirror])
    np.testing.assert_array_equal(image["cvar"], garments.mirrored_cvar(rows))
    assert len(with_mirror_images(garments, rows, None)) == 1


def test_a_mirrored_garment_is_what_a_mirror_shows():
    """Three vertices: one on the left, one in the middle, one on the right."""
    body = np.array([[1.0, 0, 5], [0, 1, 6], [-1, 0, 5]])
    mirror = np.array([2, 1, 0])
    offsets = np.array([[[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.0, 0.0, 0.7]]], dtype=np.float32)
    batch = {"offsets": offsets, "mask": np.array([[True, True, False]]), "names": ["a"]}
    image = mirror_batch(batch, mirror)
    garment, shown = body + offsets[0], body + image["offsets"][0]
    np.testing.assert_allclose(shown, (garment * [-1, 1, 1])[mirror], atol=1e-6)
    assert image["mask"].tolist() == [[False, True, True]]
    assert image["names"] == ["a"]
    again = mirror_batch(image, mirror)
    np.testing.assert_array_equal(again["offsets"], offsets)
    np.testing.assert_array_equal(again["mask"], batch["mask"])


@pytest.mark.parametrize(
    ("wanted", "expected"),
    [
        ("ab", [0, 1]),
        ("aab", [0, 1, 10]),
        ("aaabbb", [0, 1, 4, 5, 10, 11]),
        ("c", []),
        ("", []),
        ("a" * 20, [0, 2, 4, 6, 8, 10]),
    ],
)
def test_of_each_kind_as_many_as_wanted_are_evenly_spaced(wanted, expected):
    """Kinds that take turns are not fallen into step with."""
    assert rows_like([*"abababababab"], [*wanted]).tolist() == expected
