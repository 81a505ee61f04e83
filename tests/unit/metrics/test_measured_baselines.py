"""What trivial predictions of garments in motion must reach on data made for them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.metrics.baselines import MEAN, STILL, mean_wrinkles, moving_baseline_summary
from drapeline.outfits.garment_types import GARMENTS
from toys.metric_rows import find_value
from toys.moving import moving_garment

WRINKLE_M = 0.01


@pytest.fixture(scope="module")
def topology(toy_body):
    return SimpleNamespace(faces=toy_body.faces, faces_of=lambda name: toy_body.faces)


def test_mean_wrinkles_are_those_of_the_type_freed_from_pose(toy_body):
    garments = [
        moving_garment(toy_body, "train", "Tshirt", wrinkle=wrinkle, seed=seed)
        for seed, wrinkle in enumerate((0.0, WRINKLE_M))
    ] + [moving_garment(toy_body, "train", "Dress", wrinkle=3 * WRINKLE_M)]
    bodies = dict.fromkeys(GENDERS, toy_body)
    mean = mean_wrinkles(garments, bodies, step=2)
    mask = garments[0].registered.mask
    for name, expected in (("Tshirt", WRINKLE_M / 2), ("Dress", 3 * WRINKLE_M), ("Top", 0)):
        wrinkles = mean[GARMENTS.index(name)]
        np.testing.assert_allclose(
            wrinkles[mask], np.tile([expected, 0, 0], (mask.sum(), 1)), atol=1e-5
        )
        assert (wrinkles[~mask] == 0).all()


def test_mean_wrinkles_are_means_over_the_garments_that_cover_a_vertex(toy_body):
    whole, short = (
        moving_garment(toy_body, "train", "Tshirt", wrinkle=WRINKLE_M, seed=seed) for seed in (0, 1)
    )
    kept = np.arange(len(short.registered.vertex)) % 2 == 0
    mask = np.zeros_like(short.registered.mask)
    mask[short.registered.vertex[kept]] = True
    parts = {
        name: getattr(short.registered, name)[kept]
        for name in ("vertex", "corner", "bary", "weights")
    }
    short = replace(short, registered=replace(short.registered, mask=mask, **parts))
    mean = mean_wrinkles([whole, short], dict.fromkeys(GENDERS, toy_body), step=2)
    wrinkles = mean[GARMENTS.index("Tshirt")][whole.registered.mask]
    np.testing.assert_allclose(wrinkles, np.tile([WRINKLE_M, 0, 0], (len(wrinkles), 1)), atol=1e-5)


def test_baselines_reach_what_their_data_allows(toy_body, topology):

    def garments(split, *seeds):
        for seed in seeds:
            yield moving_garment(toy_body, split, "Tshirt", wrinkle=WRINKLE_M, seed=seed)

    rows = moving_baseline_summary(
        garments("train", 0, 1),
        {"test": garments("test", 2, 3)},
        dict.fromkeys(GENDERS, toy_body),
        topology,
        step=1,
        seed=0,
    )
    still, mean = (
        find_value(rows, name, "test", "all", "surface_error_mm") for name in (STILL, MEAN)
    )
    # Blended joint motions shorten a shift a little, never lengthen it.
    assert 0.85 * 1000 * WRINKLE_M < still.value <= 1000 * WRINKLE_M + 1e-3
    assert mean.value < 1e-2
    assert still.n == 12
    assert find_value(rows, "moving", "test", "all", "surface_error_mm") is None
    assert find_value(rows, "moving", "test", "all", "inside_share").model == "truth"


def test_without_training_garments_there_is_one_sentence(toy_body, topology):
    with pytest.raises(InputError, match="no sample of the training split was accepted"):
        moving_baseline_summary(
            [],
            {"test": [moving_garment(toy_body, "test", "Tshirt")]},
            dict.fromkeys(GENDERS, toy_body),
            topology,
            step=1,
            seed=0,
        )
