"""Probabilistic PCA against its closed form, with missing data, and of garments."""

import copy

import numpy as np
import pytest
import torch

from drapeline.errors import InputError
from drapeline.learning_data import training_rows
from drapeline.metrics.baselines import fit_training_pca
from drapeline.models.gcvae.data import BodyTemplate
from drapeline.models.gcvae.load import load_codec
from drapeline.models.gcvae.networks import mesh_graphs
from drapeline.models.gcvae.ppca import (
    DynamicPpca,
    Ppca,
    PpcaFit,
    StaticPpca,
    blur_mask,
    fit_ppca,
    save_fit,
)
from drapeline.models.gcvae.settings import PpcaSettings
from drapeline.models.training.batches import as_tensors
from drapeline.models.training.module import BEST
from toys.gcvae import AROUND, RINGS, ToyGarments, toy_template, tube, tube_mirror


def doubles(*shape, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(shape, generator=generator, dtype=torch.float64)


def low_rank(samples, width, rank, seed=0):
    return doubles(samples, rank, seed=seed) @ doubles(rank, width, seed=seed + 1)


def test_components_are_those_of_tipping_and_bishop():
    """Eigenvectors of the covariance, as long as the root of their variance less the noise."""
    fields = low_rank(60, 15, 3) + 0.2 * doubles(60, 15, seed=5)
    known, none = torch.ones(60, 15).bool(), torch.zeros(60, 1).double()
    fit = fit_ppca(fields, known, none, latent=3, rounds=2, ridge=1.0)
    centred = fields - fields.mean(0)
    values, vectors = torch.linalg.eigh(centred.T @ centred / 60)
    values, vectors = values.flip(0), vectors.flip(1)
    noise = values[3:].sum() / 15
    torch.testing.assert_close(fit.noise, noise)
    torch.testing.assert_close(fit.basis.norm(dim=1), (values[:3] - noise).sqrt())
    aligned = (fit.basis * vectors[:, :3].T).sum(1).abs() / fit.basis.norm(dim=1)
    torch.testing.assert_close(aligned, torch.ones(3).double())


@pytest.mark.parametrize("ridge", [0.0, 1e6])
def test_the_mean_garment_is_not_drawn_to_zero_however_strong_the_ridge(ridge):
    conditions = doubles(40, 2)
    conditions -= conditions.mean(0)
    slope = torch.tensor([[1.0, 0, 2], [0, -1, 1]]).double()
    fields = conditions @ slope + torch.tensor([5.0, -3, 0.5])
    known = torch.ones_like(fields).bool()
    fit = fit_ppca(fields, known, conditions, latent=2, rounds=1, ridge=ridge)
    torch.testing.assert_close(fit.regression[-1], torch.tensor([5.0, -3, 0.5]).double())
    expected = slope if ridge == 0 else torch.zeros_like(slope)
    torch.testing.assert_close(fit.regression[:-1], expected, atol=1e-3, rtol=1e-9)


def test_what_is_missing_is_inferred_from_what_is_known():
    """Fields of rank two with a quarter missing span the same plane as with nothing missing."""
    fields = low_rank(80, 12, 2)
    known = torch.rand(80, 12, generator=torch.Generator().manual_seed(3)) > 0.25
    spoilt, none = torch.where(known, fields, 1e3), torch.zeros(80, 1).double()
    fit = fit_ppca(spoilt, known, none, latent=2, rounds=200, ridge=1.0)
    away = fields - fit.regression[-1]
    span, _ = torch.linalg.qr(fit.basis.T)
    lost = away - away @ span @ span.T
    assert lost.norm() < 0.02 * away.norm()


def test_a_blurred_mask_is_a_ramp_across_its_hem():
    height = np.round(tube()[:, 2] / 0.6 * (RINGS - 1)).astype(int)
    mask = torch.from_numpy(height >= RINGS // 2)[:, None]
    graph = mesh_graphs(toy_template(), 1)["body"]
    ramp = blur_mask(mask, graph.laplacians[0], 12)[:, 0]
    assert ramp.abs().max() <= 1 + 1e-6
    assert torch.equal(ramp > 0, mask[:, 0])
    rows = ramp.view(RINGS, AROUND).mean(1)
    assert (rows.diff() > 0).all()
    assert rows[0] < -0.9
    assert rows[-1] > 0.9
    few = blur_mask(mask, graph.laplacians[0], 2)[:, 0].view(RINGS, AROUND).mean(1)
    # More passes, a wider ramp.
    assert few.diff().max() > rows.diff().max()


@pytest.mark.parametrize("others", [0, 1])
def test_the_posterior_is_that_of_the_whole_covariance(others):
    """Against conditioning the joint normal of z and what is known, without its structure."""
    rng = torch.Generator().manual_seed(others)
    vertices, latent, channels = 6, 3, 3 + others
    ppca = Ppca(vertices, 2, latent, torch.arange(vertices), channels).double()
    basis = torch.randn(latent, vertices * channels, generator=rng).double()
    ppca.set_fit(PpcaFit(ppca.regression, basis, torch.tensor(0.3).double()))
    field = torch.randn(vertices, channels, 1, generator=rng).double()
    mask = torch.tensor([1, 1, 0, 1, 0, 1]).bool()[:, None]
    mean, log_variance = ppca.posterior(field, mask, torch.zeros(1, 2).double())
    known = mask[:, None].repeat(1, channels, 1)
    known[:, 3:] = True
    seen = basis[:, known.flatten()]
    gain = seen @ torch.linalg.inv(seen.T @ seen + 0.3 * torch.eye(seen.shape[1]).double())
    torch.testing.assert_close(mean[0], gain @ field[known])
    covariance = torch.eye(latent).double() - gain @ seen.T
    torch.testing.assert_close(log_variance[0].exp(), covariance.diagonal())


def test_steps_of_subspace_iteration_end_where_exact_eigenvectors_do():
    """Against all eigenvectors in every round; a few rounds earlier the one lags a little."""
    fields = low_rank(50, 30, 4) + 0.1 * doubles(50, 30, seed=5)
    known = torch.rand(50, 30, generator=torch.Generator().manual_seed(3)) > 0.2
    filled = torch.where(known, fields, 0)
    for _ in range(100):
        mean = filled.mean(0)
        values, vectors = torch.linalg.eigh((filled - mean) @ (filled - mean).T / 50)
        noise = values[:-4].sum() / 30
        shrunk = vectors[:, -4:] * (1 - noise / values[-4:])
        low = shrunk @ vectors[:, -4:].T @ (filled - mean)
        filled = torch.where(known, fields, mean + low)
    none = torch.zeros(50, 1).double()
    fit = fit_ppca(torch.where(known, fields, 1e3), known, none, latent=4, rounds=100, ridge=1.0)
    torch.testing.assert_close(fit.noise, noise)
    torch.testing.assert_close(fit.regression[-1], mean)
    lengths = (values[-4:] - noise).flip(0).sqrt()
    torch.testing.assert_close(fit.basis.norm(dim=1), lengths)


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


def test_the_mean_of_the_prior_is_the_regression_on_the_conditions(fitted):
    garments = ToyGarments()
    batch = as_tensors(garments.batch(garments.rows("test")))
    zeros = torch.zeros(len(batch["cvar"]), fitted.latent)
    offsets, _ = fitted.decode(zeros, batch["cvar"], batch["topology"])
    template, constants = fitted.body_template, fitted.constants
    normal = (batch["cvar"].numpy() - template.cvar_mean) / template.cvar_std
    one = np.concatenate([normal, np.ones((len(normal), 1))], 1)
    field = (one @ fitted.ppca.regression.numpy()).reshape(len(one), -1, fitted.channels)
    expected = field[..., :3] * constants.unit_m + template.offset_mean[batch["topology"]]
    np.testing.assert_allclose(offsets.numpy(), expected, atol=1e-5)


def test_a_short_code_is_the_posterior_of_its_own_components(fitted):
    """It is that of a fit whose other components are nothing, and not the long code cut off."""
    batch = as_tensors(ToyGarments().batch(np.arange(9)))
    short = fitted.first(3)
    assert (short.latent, len(short.ppca.basis)) == (3, 3)
    silent = copy.deepcopy(fitted)
    silent.ppca.basis[3:] = 0
    code, expected, whole = (model.encode(batch) for model in (short, silent, fitted))
    torch.testing.assert_close(code.mean, expected.mean[:, :3])
    torch.testing.assert_close(expected.mean[:, 3:], torch.zeros_like(expected.mean[:, 3:]))
    assert not torch.allclose(code.mean, whole.mean[:, :3], atol=1e-3)
    given = batch["cvar"], batch["topology"]
    torch.testing.assert_close(
        short.decode(code.mean, *given), silent.decode(expected.mean, *given)
    )


def test_pca_and_masked_pca_learn_from_the_same_rows_and_images(monkeypatch):
    """Each reads rows once, the same ones, and the conditions of their mirror images."""
    monkeypatch.setattr(training_rows, "LINEAR_ROWS_MAX", 20)
    monkeypatch.setattr(BodyTemplate, "mirror", property(lambda self: tube_mirror()))
    read = {}

    class Recorded(ToyGarments):
        def __init__(self, name):
            super().__init__()
            self.seen = read[name] = []

        def batch(self, rows):
            self.seen.append(("rows", *rows))
            return super().batch(rows)

        def mirrored_cvar(self, rows):
            self.seen.append(("images", *rows))
            return super().cvar(rows)

    StaticPpca(PpcaSettings(latent=4, seed=5), toy_template()).fit(Recorded("ppca"))
    fit_training_pca(Recorded("pca"), tube_mirror(), components=4, seed=5)
    assert read["ppca"] == read["pca"]
    assert [(kind, len(rows)) for kind, *rows in read["pca"]] == [("rows", 20), ("images", 20)]


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
