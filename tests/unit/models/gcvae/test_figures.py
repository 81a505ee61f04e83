"""What held-out garments are shown with."""

from types import SimpleNamespace

import numpy as np

from drapeline.models.gcvae import figures
from drapeline.models.gcvae.codec import Codes
from drapeline.outfits.garment_types import GARMENTS
from drapeline.seeding import rng_for


class Frames:
    """Two hundred frames of two garments; the last fifty are held out."""

    data = SimpleNamespace(
        garment_index=np.repeat([0, 1], 100),
        garment=np.array([GARMENTS.index("Skirt"), GARMENTS.index("Tshirt")]),
    )

    def rows(self, split):
        return np.arange(150) if split == "train" else np.arange(150, 200)


def test_wrinkle_codes_are_spread_like_those_of_training_frames_of_the_type(monkeypatch):
    rng = rng_for(0, "codes")
    known = np.where(Frames.data.garment_index[:, None], 5.0, -5.0) + rng.standard_normal((200, 8))
    seen = []

    def encoded(model, garments, rows):
        seen.extend(rows)
        return Codes(known[rows], np.zeros((len(rows), 8)))

    monkeypatch.setattr(figures, "encode_garments", encoded)
    for name, expected in (("Skirt", range(100)), ("Tshirt", range(100, 150))):
        seen.clear()
        drawn = figures._wrinkle_codes(rng, None, Frames(), name, 400)
        assert drawn.shape == (400, 8)
        assert set(seen) <= set(expected)
        own = known[list(expected)]
        np.testing.assert_allclose(drawn.mean(axis=0), own.mean(axis=0), atol=0.2)
        np.testing.assert_allclose(drawn.std(axis=0), own.std(axis=0), rtol=0.2)
    seen.clear()
    figures._wrinkle_codes(rng, None, Frames(), "Dress", 2)  # no training frame wears one
    assert set(seen) <= set(range(150))
