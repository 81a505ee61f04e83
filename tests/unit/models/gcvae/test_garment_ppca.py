"""Garments as masked probabilistic PCA."""

import numpy as np
import pytest
import torch

from drapeline.errors import InputError
from drapeline.models.gcvae.load import load_codec
from drapeline.models.gcvae.ppca import DynamicPpca, StaticPpca, mirror_batch, save_fit
from drapeline.models.gcvae.settings import PpcaSettings
from drapeline.models.training.batches import as_tensors
from drapeline.models.training.module import BEST
from toys.gcvae import ToyGarments, toy_template


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


def test_few_components_hold_all_of_the_toys(fitted):
    """Radius, slant, hem and shape are few numbers."""
    garments = ToyGarments()
    batch = as_tensors(garments.batch(garments.rows("test")))
    with torch.inference_mode():
        z = fitted.encode(batch).mean
        offsets, mask = fitted.decode(z, batch["cvar"], batch["topology"])
    error = (offsets - batch["offsets"]).norm(dim=-1)[batch["mask"]].mean()
    assert error < 0.5e-3
    seen = mask > 0.5
    overlap = (seen & batch["mask"]).sum(1) / (seen | batch["mask"]).sum(1)
    assert overlap.mean() > 0.93


def test_offsets_outside_the_mask_are_not_looked_at(fitted):
    garments = ToyGarments()
    batch = as_tensors(garments.batch(garments.rows("test")))
    code = fitted.encode(batch)
    outside = ~batch["mask"][..., None]
    changed = {**batch, "offsets": torch.where(outside, 1.0, batch["offsets"])}
    for part, again in zip(code, fitted.encode(changed), strict=True):
        torch.testing.assert_close(part, again)


def test_the_fit_looks_at_training_rows_and_within_masks_alone(fitted):
    garments = ToyGarments()
    for split in ("val", "test"):
        garments.offsets[garments.rows(split)] = 7.0
    garments.offsets[~garments.mask] = 7.0
    model = StaticPpca(fitted.settings, toy_template())
    model.fit(garments)
    for key, value in model.ppca.state_dict().items():
        torch.testing.assert_close(value, fitted.ppca.state_dict()[key])


def test_offsets_that_are_not_finite_are_refused_by_name(fitted):
    garments = ToyGarments()
    garments.offsets[5, 3] = np.inf
    model = StaticPpca(fitted.settings, toy_template())
    with pytest.raises(InputError, match="^samples toy005: offsets hold NaN"):
        model.fit(garments)


@pytest.mark.parametrize("cls", [StaticPpca, DynamicPpca])
def test_a_saved_fit_is_loaded_again_and_needs_no_training(tmp_path, cls):
    """Codes and garments are the same to the bit."""
    garments = ToyGarments()
    model = cls(PpcaSettings(latent=8, seed=3), toy_template())
    model.fit(garments)
    save_fit(tmp_path / "fit", model)
    assert sorted(path.name for path in (tmp_path / "fit").iterdir()) == [
        BEST,
        "manifest.tsv",
        "settings.json",
    ]
    again = load_codec(tmp_path / "fit" / BEST)
    assert type(again) is cls
    assert (again.latent, again.seed) == (8, 3)
    batch = as_tensors(garments.batch(garments.rows("test")))
    z = model.encode(batch).mean
    assert torch.equal(again.encode(batch).mean, z)
    offsets, mask = again.decode(z, batch["cvar"], batch["topology"])
    expected, _ = model.decode(z, batch["cvar"], batch["topology"])
    assert torch.equal(offsets, expected)
    assert (mask is None) == (cls is DynamicPpca)
