"""Codes of garments in the plane."""

import numpy as np
import pytest

from drapeline.outfits.garment_types import GARMENTS
from drapeline.report.models.gcvae.figures import plot_codes
from drapeline.seeding import rng_for


@pytest.fixture(scope="module")
def clusters():
    rng = rng_for(0, "clusters")
    kind = np.arange(150) % 3
    return rng.normal(size=(3, 20))[kind] * 3 + rng.normal(size=(150, 20)) * 0.5, kind


def test_codes_are_drawn_in_the_colours_of_their_types(clusters, tmp_path):
    points, kind = clusters
    names = [GARMENTS[k] for k in kind]
    plot_codes(tmp_path / "codes.svg", points, names, ["train"] * 100 + ["test"] * 50)
    text = (tmp_path / "codes.svg").read_text()
    for name in GARMENTS:
        assert (f">{name}<" in text) == (name in names)
