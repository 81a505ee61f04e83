"""Probabilistic PCA against its closed form, and where part of the data is missing."""

import numpy as np
import pytest
import torch

from drapeline.models.gcvae.networks import mesh_graphs
from drapeline.models.gcvae.ppca import Ppca, PpcaFit, blur_mask, fit_ppca
from toys.gcvae import AROUND, RINGS, toy_template, tube


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
