from copy import deepcopy

import numpy as np
import pytest
import torch

from drapeline.models.training.optimise import (
    CodePrior,
    CosineAdam,
    JointOptimizer,
    Linearised,
    Muon,
    fit_least_squares,
    orthogonalise,
    spread_codes,
)


def parameters():
    rng = torch.Generator().manual_seed(0)
    return [torch.nn.Parameter(torch.randn(3, 2, generator=rng)) for _ in range(2)]


def parts(pair):
    return [torch.optim.Adam(pair[:1], lr=0.1), torch.optim.SGD(pair[1:], lr=0.2, momentum=0.9)]


def descend(pair, optimizers, steps):
    for _ in range(steps):
        for one in optimizers:
            one.zero_grad()
        sum((p**2).sum() for p in pair).backward()
        for one in optimizers:
            one.step()


def test_parts_step_as_they_do_alone():
    together, alone = parameters(), parameters()
    descend(together, [JointOptimizer(parts(together))], 5)
    descend(alone, parts(alone), 5)
    for a, b in zip(together, alone, strict=True):
        assert torch.equal(a, b)


def test_the_state_is_kept_and_learning_rates_stay_shared():
    one = parameters()
    optimizer = JointOptimizer(parts(one))
    descend(one, [optimizer], 3)
    other = [torch.nn.Parameter(p.detach().clone()) for p in one]
    resumed = JointOptimizer(parts(other))
    resumed.load_state_dict(deepcopy(optimizer.state_dict()))
    for optimiser in (optimizer, resumed):
        for group in optimiser.param_groups:
            group["lr"] *= 0.5
    descend(one, [optimizer], 3)
    descend(other, [resumed], 3)
    for a, b in zip(one, other, strict=True):
        assert torch.equal(a, b)


def test_a_closure_is_evaluated_once():
    pair = parameters()
    calls = []
    optimizer = JointOptimizer(parts(pair))

    def closure():
        calls.append(1)
        optimizer.zero_grad()
        loss = sum((p**2).sum() for p in pair)
        loss.backward()
        return loss

    before = float(sum((p**2).sum() for p in pair).detach())
    assert float(optimizer.step(closure).detach()) == before
    assert len(calls) == 1
    assert float(sum((p**2).sum() for p in pair).detach()) < before


@pytest.mark.parametrize("shape", [(8, 8), (5, 12), (12, 5)])
def test_a_matrix_becomes_orthogonal_and_keeps_its_directions(shape):
    rng = torch.Generator().manual_seed(0)
    u, _, v = torch.linalg.svd(torch.randn(shape, generator=rng), full_matrices=False)
    values = torch.logspace(-1.5, 0, min(shape))
    found = orthogonalise(37 * u * values @ v)
    inside = u.T @ found @ v.T
    assert ((inside.diag() > 0.5) & (inside.diag() < 1.3)).all()
    assert (inside - torch.diag(inside.diag())).abs().max() < 1e-4
    assert (orthogonalise(torch.zeros(shape)) == 0).all()


def test_steps_are_those_of_torchs_muon_but_for_its_rounding(monkeypatch):
    monkeypatch.setattr(torch.Tensor, "bfloat16", torch.Tensor.clone)

    def matrices():
        rng = torch.Generator().manual_seed(0)
        return [torch.nn.Parameter(torch.randn(shape, generator=rng)) for shape in ((6, 9), (9, 6))]

    def go(optimizer, pair):
        rng = torch.Generator().manual_seed(1)
        for _ in range(4):
            for matrix in pair:
                matrix.grad = torch.randn(matrix.shape, generator=rng)
            optimizer.step()
        return pair

    pair = matrices()
    theirs = torch.optim.Muon(
        other := matrices(), lr=0.01, weight_decay=0.0, adjust_lr_fn="match_rms_adamw"
    )
    for start, a, b in zip(
        matrices(), go(Muon(pair, lr=0.01), pair), go(theirs, other), strict=True
    ):
        assert (a - start).norm() > 0.01
        assert (a - b).norm() < 0.001 * (a - start).norm()


def test_matrices_without_a_gradient_stay():
    one, other = (torch.nn.Parameter(torch.ones(2, 2)) for _ in range(2))
    one.grad = torch.eye(2)
    Muon([one, other], lr=0.1).step()
    assert (other == 1).all()
    assert (one != 1).any()


def squares(slopes, target, prior):
    """Of the linear residuals slopes x - target, with a prior."""

    def linearise(x):
        residual = (slopes @ x[..., None])[..., 0] - target
        loss = residual.square().sum(1) + prior * x.square().sum(1)
        weight, own = torch.ones_like(residual), prior * torch.ones_like(x)
        return Linearised(residual, slopes, weight, own, loss)

    return linearise


def test_linear_least_squares_come_to_their_solution():
    rng = torch.Generator().manual_seed(0)
    slopes = torch.randn(2, 9, 3, generator=rng, dtype=torch.float64)
    target = torch.randn(2, 9, generator=rng, dtype=torch.float64)
    found = fit_least_squares(torch.zeros_like(slopes[:, 0]), squares(slopes, target, 0.5), 30)
    system = slopes.mT @ slopes + 0.5 * torch.eye(3, dtype=torch.float64)
    expected = torch.linalg.solve(system, (slopes.mT @ target[..., None])[..., 0])
    torch.testing.assert_close(found, expected, atol=1e-8, rtol=0)


def test_steps_up_are_taken_back():
    """Of two fits, one whose derivatives are wrong stays where it started."""
    slopes = torch.ones(2, 4, 1, dtype=torch.float64)
    target = torch.tensor([[3.0], [3.0]], dtype=torch.float64).expand(2, 4)
    honest = squares(slopes, target, 0.0)
    wrong = torch.tensor([1.0, -1.0], dtype=torch.float64)[:, None, None]

    def linearise(x):
        here = honest(x)
        return here._replace(slopes=here.slopes * wrong)

    found = fit_least_squares(torch.zeros(2, 1, dtype=torch.float64), linearise, 20)
    torch.testing.assert_close(found[0, 0].item(), 3.0, atol=1e-6, rtol=0)
    assert found[1, 0] == 0


def test_adam_comes_to_rest_at_the_least_loss():
    goal = torch.tensor([[1.0, -2.0], [0.5, 3.0]])
    adam = CosineAdam(torch.zeros(2, 2), rate=0.2, steps=200)
    for _ in range(200):
        adam.step(lambda x: (x - goal).square().mean(1))
    torch.testing.assert_close(adam.x.detach(), goal, atol=1e-3, rtol=0)
    before = adam.x.detach().clone()
    adam.step(lambda x: x.square().sum(1))
    assert (adam.x - before).abs().max() < 1e-2


def test_the_prior_is_that_of_the_codes():
    codes = np.random.default_rng(0).normal(size=(400, 3)) * [1, 0.1, 5] + [3, 0, -2]
    prior = CodePrior.of(codes)
    z = torch.from_numpy(codes.astype(np.float32))
    w = prior.whiten(z)
    torch.testing.assert_close(prior.codes(w), z, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(np.cov(w.T, bias=True)[[0, 2], [0, 2]], 1, atol=0.05)
    np.testing.assert_allclose(w.mean(0), 0, atol=1e-3)


def test_starts_are_the_mean_and_codes_far_from_one_another():
    codes = np.array([[0.0, 0], [0.1, 0], [10, 0], [0, 10], [-10, -10]])
    found = spread_codes(codes, 3)
    np.testing.assert_allclose(found[0], codes.mean(axis=0), atol=1e-6)
    assert {tuple(row) for row in found[1:].tolist()} == {(10.0, 0), (0.0, 10), (-10.0, -10)}
    assert len(spread_codes(codes, 99)) == 6
