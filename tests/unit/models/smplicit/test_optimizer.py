from copy import deepcopy

import pytest
import torch

from drapeline.models.smplicit.optimizer import JointOptimizer, Muon, orthogonalise


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
