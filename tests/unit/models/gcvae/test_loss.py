"""Equations 3 and 4: terms by hand, by integration and by slow twins, and what they teach."""

import math

import numpy as np
import pytest
import torch

from drapeline.geometry.mesh import face_normals, faces_within
from drapeline.models.gcvae.codec import kl_nat
from drapeline.models.gcvae.networks import Code
from drapeline.models.gcvae.settings import GcvaeLoss, GcvaeNetwork, GcvaeTraining, VaeSettings
from drapeline.models.gcvae.vae import (
    StaticVae,
    conditions_of,
    distance_sums,
    mask_sums,
    normal_sums,
    offset_sums,
)
from drapeline.models.layers.graphs import FaceNormals
from drapeline.models.training.batches import as_tensors
from drapeline.models.training.module import Progress
from drapeline.registration.to_body.topology import TOPOLOGIES
from toys.gcvae import ToyGarments, toy_template
from toys.paper import printed

PRINTED = GcvaeLoss(**printed("gcvae.loss"))
ROWS = np.arange(6)


def rng(seed=0):
    return torch.Generator().manual_seed(seed)


def doubles(*shape, seed=0):
    return torch.randn(shape, generator=rng(seed), dtype=torch.float64)


# ---- the terms themselves


@pytest.mark.parametrize(("mean", "deviation"), [(0.0, 1.0), (0.7, 0.3), (-1.5, 1.8), (2.0, 1.0)])
def test_kl_is_the_integral_of_the_log_ratio_of_densities(mean, deviation):
    z = np.linspace(mean - 12 * deviation, mean + 12 * deviation, 200_001)
    log_q = -0.5 * ((z - mean) / deviation) ** 2 - np.log(deviation * np.sqrt(2 * np.pi))
    log_p = -0.5 * z**2 - np.log(np.sqrt(2 * np.pi))
    integral = (np.exp(log_q) * (log_q - log_p)).sum() * (z[1] - z[0])
    code = (torch.full((1, 1), x, dtype=float) for x in (mean, 2 * math.log(deviation)))
    assert float(kl_nat(*code)) == pytest.approx(integral, abs=1e-9)


def test_a_step_against_the_gradient_of_kl_leads_to_the_prior():
    mean, log_variance = doubles(5, 8).requires_grad_(), doubles(5, 8, seed=1).requires_grad_()
    slopes = torch.autograd.grad(kl_nat(mean, log_variance).sum(), (mean, log_variance))
    with torch.no_grad():
        for value, slope in zip((mean, log_variance), slopes, strict=True):
            assert ((value - 1e-3 * slope).abs() < value.abs()).all()


def test_offsets_are_absolute_differences_of_the_coordinates_that_count():
    true = torch.zeros(2, 3, 2)
    predicted = torch.tensor([[[1.0, 5], [-2, 5], [3, 5]], [[0.5, 5], [0, 5], [0, 5]]])
    mask = torch.tensor([[True, False], [True, False]])
    assert offset_sums(predicted, true, mask).tolist() == [6.5, 6]
    assert offset_sums(predicted, true, None).tolist() == [36.5, 12]


def test_distances_are_in_centimetres():
    true = torch.zeros(2, 3, 1)
    predicted = torch.tensor([[[0.03], [0.04], [0.0]], [[7.0], [7], [7]]])
    total, count = distance_sums(predicted, true, torch.tensor([[True], [False]]))
    assert float(total) == pytest.approx(5, rel=1e-5)
    assert count == 1
    total, count = distance_sums(predicted, true, None)
    assert float(total) == pytest.approx(5 + 700 * math.sqrt(3), rel=1e-5)
    assert count == 2


def test_the_normals_term_is_zero_for_equal_faces_and_grows_as_one_turns():
    flat = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])[..., None]
    normals = FaceNormals(np.array([[0, 1, 2]]), 3, parts=1, rng=np.random.default_rng(0))
    angles, found = torch.linspace(0, math.pi / 2, 7), []
    for angle in angles.tolist():
        cosine, sine = math.cos(angle), math.sin(angle)
        turn = torch.tensor([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])
        turned = torch.einsum("ij,vjb->vib", turn, flat)
        total, count = normal_sums(normals(turned), normals(flat), torch.tensor([[True]]))
        assert count == 1
        found.append(float(total))
    np.testing.assert_allclose(found, angles.sin() + 1 - angles.cos(), atol=1e-6)
    outside = normal_sums(normals(turned), normals(flat), torch.tensor([[False]]))
    assert outside.tolist() == [0, 0]


@pytest.mark.parametrize("form", ["l1", "bce"])
def test_the_mask_term_by_hand(form):
    logit, mask = torch.tensor([[0.0, 2.0], [-1.0, -3.0]]), torch.tensor([[1, 1], [0, 1]]).bool()
    right = [1 / (1 + math.exp(x)) for x in (0.0, -2.0, -1.0, 3.0)]  # what the truth is given
    wanted = sum(1 - p if form == "l1" else -math.log(p) for p in right)
    total, count = mask_sums(logit, mask, form)
    assert float(total) == pytest.approx(wanted, rel=1e-6)
    assert count == 4


@pytest.mark.parametrize("form", ["l1", "bce"])
def test_a_step_against_the_gradient_of_the_mask_term_leads_to_the_mask(form):
    logit, mask = doubles(9, 4).requires_grad_(), doubles(9, 4, seed=1) > 0
    (slope,) = torch.autograd.grad(mask_sums(logit, mask, form)[0], logit)
    assert (slope[mask] < 0).all()
    assert (slope[~mask] > 0).all()


def test_gradients_by_finite_differences():
    true, mask = doubles(7, 3, 4, seed=1), doubles(7, 4, seed=2) > 0
    predicted, logit = doubles(7, 3, 4).requires_grad_(), doubles(7, 4).requires_grad_()
    mean, log_variance = doubles(4, 5).requires_grad_(), doubles(4, 5, seed=3).requires_grad_()
    for within in (mask, None):
        assert torch.autograd.gradcheck(lambda x, m=within: offset_sums(x, true, m)[0], predicted)
        assert torch.autograd.gradcheck(lambda x, m=within: distance_sums(x, true, m)[0], predicted)
    assert torch.autograd.gradcheck(lambda x: normal_sums(x, true, mask)[0], predicted)
    for form in ("l1", "bce"):
        assert torch.autograd.gradcheck(lambda x, f=form: mask_sums(x, mask, f)[0], logit)
    assert torch.autograd.gradcheck(kl_nat, (mean, log_variance))


def test_weights_are_the_printed_ones():
    loss = PRINTED
    assert (loss.normals, loss.mask, loss.condition) == (70, 0.1, 1)
    assert (loss.mask_form, loss.offsets_form, loss.offsets_within) == ("l1", "l1", "mask")
    epochs = np.arange(101)
    wanted = np.minimum(1e-4 + 0.005 * np.maximum(epochs - 50, 0), 0.25)
    np.testing.assert_allclose([loss.kl_weight(epoch / 100) for epoch in epochs], wanted)


# ---- the terms of a network and a batch

SETTINGS = VaeSettings(
    network=GcvaeNetwork(widths=(6, 8, 8, 10), features=12, latent=8, condition=4),
    loss=PRINTED,
    training=GcvaeTraining(steps=100, batch=32, normal_parts=1),
)


def vae(**loss):
    """In 64 bits, and with a last layer that is not zero."""
    model = StaticVae(SETTINGS.replace(loss=loss), toy_template())
    with torch.no_grad():
        model.network.decoder.branches.bias.normal_(std=0.3, generator=rng(2))
        model.network.decoder.branches.weight.normal_(std=0.1, generator=rng(3))
    return model.double()


def toy_batch():
    """Garments of both topologies."""
    batch = as_tensors(ToyGarments().batch(np.arange(6)))
    assert set(batch["topology"].tolist()) == {0, 1}
    wide = {
        key: x.double() for key, x in batch.items() if torch.is_tensor(x) and x.is_floating_point()
    }
    return {**batch, **wide}


def decoded(model, batch):
    """Parts of the batch, and what their mean codes decode to."""
    parts = model.parts(batch)
    cvar, counts = conditions_of(parts)
    code = model.encode_parts(parts)
    return parts, model.decode_parts(code.mean, cvar, counts)


def slow_terms(domain, batch, parts, out, form="l1", within="mask"):
    """Equation 4's terms, garment by garment, in plain arrays."""
    found = {"offsets": [], "normals": [], "mask": []}
    for name, part in parts.items():
        for column, row in enumerate(part.rows.tolist()):
            mask, true = batch["mask"][row].numpy(), batch["offsets"][row].numpy()
            made, logit = np.split(out[name][..., column].detach().numpy(), [3], axis=1)
            code = TOPOLOGIES.index(name)
            metres = made * domain.offset_std[code] + domain.offset_mean[code]
            counted = mask if within == "mask" else np.ones_like(mask)
            if form == "l1":
                target = (true - domain.offset_mean[code]) / domain.offset_std[code]
                found["offsets"].extend(np.abs(made - target)[counted].ravel())
            else:
                found["offsets"].extend(100 * np.linalg.norm(metres - true, axis=1)[counted])
            shape, (gender, *_) = np.split(batch["cvar"][row].numpy(), [10])
            mean, *directions = np.split(domain.body_basis, 2)[int(gender)]
            body = mean + np.tensordot(shape, directions, 1)
            faces = faces_within(domain.faces[name], mask)
            made, true = (face_normals(body + offsets, faces) for offsets in (metres, true))
            found["normals"].extend(np.abs(made - true).sum(axis=1))
            found["mask"].extend(np.abs(1 / (1 + np.exp(-logit[:, 0])) - mask))
    return {name: np.mean(values) for name, values in found.items()}


@pytest.mark.parametrize("within", ["mask", "all"])
@pytest.mark.parametrize("form", ["l1", "distance"])
def test_terms_of_a_batch_are_means_over_all_its_garments(form, within):
    model, batch = vae(offsets_form=form, offsets_within=within), toy_batch()
    parts, out = decoded(model, batch)
    found = model.garment_terms(parts, out, 0)
    for name, wanted in slow_terms(toy_template(), batch, parts, out, form, within).items():
        assert float(found.pop(name).detach()) == pytest.approx(wanted, rel=1e-4), name
    assert not found


def test_the_truth_has_no_loss():
    model, parts = vae(), vae().parts(toy_batch())
    sure = {n: torch.where(part.mask, 40.0, -40.0)[:, None].double() for n, part in parts.items()}
    out = {name: torch.cat([part.target, sure[name]], 1) for name, part in parts.items()}
    for name, term in model.garment_terms(parts, out, 0).items():
        assert float(term) == pytest.approx(0, abs=1e-6), name


def test_terms_of_a_code_are_per_component():
    model, cvar = vae(), toy_batch()["cvar"]
    wanted = model.conditioning(cvar)
    zero = torch.zeros(len(cvar), 8).double()
    terms = model.code_terms(Code(zero, zero, wanted), cvar)
    assert (float(terms["kl"]), float(terms["condition"])) == (0, 0)
    terms = model.code_terms(Code(zero + 3, zero, wanted + 0.2), cvar)
    assert float(terms["kl"]) == pytest.approx(4.5)
    assert float(terms["condition"]) == pytest.approx(0.2)
    terms = model.code_terms(Code(zero, zero - 2, -wanted), cvar)
    assert float(terms["kl"]) == pytest.approx((math.exp(-2) + 1) / 2)
    assert float(terms["condition"]) == pytest.approx(2 * float(wanted.abs().mean()))


@pytest.mark.parametrize(("share", "kl"), [(0, 1e-4), (0.5, 1e-4), (0.6, 0.0501), (0.99, 0.2451)])
def test_the_loss_is_the_sum_of_equations_3_and_4(share, kl):
    model = vae()
    model.progress = Progress(step=1000, share=share)
    loss = model.training_step(toy_batch())
    (logged,) = model.logged
    weights = {"offsets": 1, "normals": 70, "mask": 0.1, "condition": 1, "kl": kl}
    assert logged.values.keys() == {"train_loss", *(f"train_{name}" for name in weights)}
    terms = {name: float(logged.values[f"train_{name}"]) for name in weights}
    assert min(terms.values()) > 0
    total = sum(weight * terms[name] for name, weight in weights.items())
    assert float(loss.detach()) == pytest.approx(total, rel=1e-9)


def test_codes_are_drawn_with_the_posterior_s_mean_and_deviation(monkeypatch):
    model, drawn = vae(), []

    def code(parts):
        mean = torch.full((6, 5000), 3.0).double()
        return Code(mean, torch.full_like(mean, 2 * math.log(0.25)), torch.zeros(6, 4).double())

    def decode(z, cvar, counts):
        drawn.append(z)
        return {
            name: torch.zeros(len(toy_template().body_mean), 4, n) for name, n in counts.items()
        }

    monkeypatch.setattr(model, "encode_parts", code)
    monkeypatch.setattr(model, "decode_parts", decode)
    for step in (0, 0, 1):
        model.progress = Progress(step=step)
        model.training_step(toy_batch())
    assert float(drawn[0].mean()) == pytest.approx(3, abs=0.01)
    assert float(drawn[0].std()) == pytest.approx(0.25, abs=0.01)
    assert torch.equal(drawn[0], drawn[1])
    assert not torch.equal(drawn[0], drawn[2])


def test_the_best_weights_are_chosen_by_offsets_and_a_tenth_of_kl():
    model, batch = vae(), toy_batch()
    model.validation_step(batch)
    (logged,) = model.logged
    values = {name.removeprefix("val_"): float(value) for name, value in logged.values.items()}
    parts, out = decoded(model, batch)
    terms = slow_terms(toy_template(), batch, parts, out)
    assert values["offsets"] == pytest.approx(terms["offsets"], rel=1e-4)
    assert values["kl_nat"] > 0
    chosen = values["offsets"] + 0.1 * values["kl_nat"] / 8
    assert values["selection"] == pytest.approx(chosen, rel=1e-9)


def test_validation_tells_millimetres_and_the_overlap_of_masks():
    model, batch = vae(), toy_batch()
    model.validation_step(batch)
    values = model.logged[0].values
    parts, out = decoded(model, batch)
    errors, overlaps = [], []
    for name, part in parts.items():
        for column, row in enumerate(part.rows.tolist()):
            mask, true = batch["mask"][row].numpy(), batch["offsets"][row].numpy()
            made = out[name][..., column].detach().numpy()
            code = TOPOLOGIES.index(name)
            metres = made[:, :3] * toy_template().offset_std[code]
            metres = metres + toy_template().offset_mean[code]
            errors.append(1000 * np.linalg.norm(metres - true, axis=1)[mask].mean())
            seen = 1 / (1 + np.exp(-made[:, 3])) > 0.5
            overlaps.append((seen & mask).sum() / (seen | mask).sum())
    assert float(values["val_surface_error_mm"]) == pytest.approx(np.mean(errors), rel=1e-4)
    assert float(values["val_mask_iou"]) == pytest.approx(np.mean(overlaps), rel=1e-5)


@pytest.mark.parametrize("name", ["offsets", "normals", "mask"])
def test_a_step_against_the_gradient_of_a_term_lowers_what_it_stands_for(name):
    model, batch = vae(), toy_batch()
    parts, out = decoded(model, batch)
    before = slow_terms(toy_template(), batch, parts, out)
    term = model.garment_terms(parts, out, 0)[name]
    trained = [p for p in model.network.parameters() if p.requires_grad]
    slopes = torch.autograd.grad(term, trained, allow_unused=True)
    size = sum(float(slope.square().sum()) for slope in slopes if slope is not None)
    with torch.no_grad():
        for parameter, slope in zip(trained, slopes, strict=True):
            if slope is not None:
                parameter.sub_(slope, alpha=1e-5 * before[name] / size)
    after = slow_terms(toy_template(), batch, *decoded(model, batch))
    # To first order, the step lowers the term by a hundred thousandth of itself.
    assert (before[name] - after[name]) / before[name] == pytest.approx(1e-5, rel=0.1)


def test_kl_is_that_of_torch_summed_over_the_code_and_zero_for_the_prior():
    mean, log_variance = torch.randn(2, 5, 8, generator=torch.Generator().manual_seed(0)).double()
    normal = torch.distributions.Normal
    expected = torch.distributions.kl_divergence(
        normal(mean, (log_variance / 2).exp()), normal(0.0, 1.0)
    )
    torch.testing.assert_close(kl_nat(mean, log_variance), expected.sum(1), rtol=1e-10, atol=0)
    assert (kl_nat(torch.zeros(3, 8), torch.zeros(3, 8)) == 0).all()


def test_the_printed_schedule_of_the_kl_weight():
    loss = PRINTED
    assert loss.kl_weight(0.0) == loss.kl_weight(0.5) == 1e-4
    assert loss.kl_weight(0.51) == pytest.approx(1e-4 + 0.005)
    assert loss.kl_weight(1.0) == 0.25
