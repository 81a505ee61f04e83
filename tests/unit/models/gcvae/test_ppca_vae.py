"""What the closed-form garment VAEs make of garments before they are fitted."""

import numpy as np

from drapeline.models.gcvae.ppca_vae import mirror_batch


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
