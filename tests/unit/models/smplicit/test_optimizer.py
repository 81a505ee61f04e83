from copy import deepcopy

import torch

from drapeline.models.smplicit.optimizer import JointOptimizer


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
