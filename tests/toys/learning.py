"""What a training does on any processor: it follows true gradients and learns one batch by heart.

How far a stochastic training gets is no such fact: it differs from processor to processor.
"""

from collections.abc import Callable, Mapping
from copy import deepcopy
from typing import Any, TypeVar

import torch
from torch import nn

from drapeline.models.training.module import TrainableModule

# A loss jumps where other points become neighbours. Where the jumps are is a matter of the last
# digit and so of the processor, but few steps that shrink to a hundredth all have one within.
_STEPS = (1e-6, 1e-7, 1e-8)
_DROPS = (1e-3, 1e-4, 1e-5)
M = TypeVar("M", bound=nn.Module)


def doubles(batch: Mapping[str, Any]) -> dict[str, Any]:
    """A batch with its decimal numbers in 64 bits."""
    return {
        key: value.double() if torch.is_tensor(value) and value.is_floating_point() else value
        for key, value in batch.items()
    }


def shake_weights(module: M, size: float) -> M:
    """Add noise of a size to all weights that a training changes: some layers begin as zero."""
    rng = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for weight in trained_weights(module).values():
            weight.add_(size * torch.randn(weight.shape, generator=rng))
    return module


def trained_weights(module: nn.Module) -> dict[str, nn.Parameter]:
    """Those that a training changes, by name."""
    return {name: x for name, x in module.named_parameters() if x.requires_grad}


def assert_true_gradients(module: M, loss: Callable[[M], torch.Tensor]) -> None:
    """Fail unless the gradient is what central differences say, for every tensor of weights.

    The direction is half the gradient's own, half random: along the former nothing drowns in what
    other weights do, and the latter finds what is missing from the gradient.

    Args:
        module: in 64 bits; it is left as it was.
        loss: of a module, with the same noise in every call.
    """
    module = _settled(module, loss)
    _, slopes = _loss_and_slopes(module, loss)
    rng = torch.Generator().manual_seed(0)
    for name, slope in slopes.items():
        size = slope.norm()
        assert size > 0, f"{name}: no gradient"
        direction = torch.randn(slope.shape, generator=rng, dtype=slope.dtype)
        direction = slope / size + direction / direction.norm()
        expected, errors = (slope * direction).sum(), []
        for step in _STEPS:
            up, down = (
                _loss_at(module, loss, {name: sign * step * direction}) for sign in (1.0, -1.0)
            )
            errors.append(float(abs((up - down) / (2 * step) - expected) / size))
        assert min(errors) < 1e-3, (name, errors)


def assert_a_step_lowers(module: M, loss: Callable[[M], torch.Tensor]) -> None:
    """Fail unless a small step against the gradient lowers the loss by what the gradient promises.

    Args:
        module, loss: see `assert_true_gradients`.
    """
    module = _settled(module, loss)
    before, slopes = _loss_and_slopes(module, loss)
    steepness = sum(slope.square().sum() for slope in slopes.values())
    shares = []
    for drop in _DROPS:
        length = drop * before / steepness
        after = _loss_at(module, loss, {name: -length * slope for name, slope in slopes.items()})
        shares.append(float((before - after) / (drop * before)))
    assert max(shares) > 0.5, shares


def _settled(module: M, loss: Callable[[M], torch.Tensor]) -> M:
    """A copy whose running statistics are the batch's; they change when gradients are on."""
    twin = deepcopy(module)
    loss(twin)
    return twin


def _loss_and_slopes(
    module: M, loss: Callable[[M], torch.Tensor]
) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
    value, weights = loss(module), trained_weights(module)
    slopes = torch.autograd.grad(value, list(weights.values()))
    return value.detach(), dict(zip(weights, slopes, strict=True))


@torch.no_grad()
def _loss_at(
    module: M, loss: Callable[[M], torch.Tensor], moves: Mapping[str, torch.Tensor]
) -> torch.Tensor:
    before = {name: module.get_parameter(name).clone() for name in moves}
    for name, move in moves.items():
        module.get_parameter(name).add_(move)
    value = loss(module)
    for name, weight in before.items():
        module.get_parameter(name).copy_(weight)
    return value


def assert_learned_by_heart(
    module: TrainableModule, batch: Mapping[str, Any], name: str, *, steps: int
) -> None:
    """Fail unless steps with one and the same batch bring an error down to a tenth.

    Args:
        module: to train.
        batch: to learn.
        name: of the error, logged as `train_{name}`.
        steps: at most so many, several times those that it takes, since no two processors go the
            same way.
    """
    optimiser, errors = module.optimizer(), []
    while not errors or min(errors) >= 0.1 * errors[0]:
        assert len(errors) < steps, errors[:: max(1, steps // 10)]
        loss = module.training_step(dict(batch))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        (logged,) = module.logged
        module.logged.clear()
        errors.append(float(logged.values[f"train_{name}"]))


def assert_mixed_precision_agrees(
    module: M, loss: Callable[[M], torch.Tensor], *, cosine: float
) -> None:
    """Fail unless loss and gradient are almost the same, but not quite, with 16 bits for products.

    Args:
        module: in 32 bits; it is left as it was.
        loss: see `assert_true_gradients`.
        cosine: least one between the gradients. With any above zero, a small step against the
            gradient in 16 bits lowers the loss in 32.
    """
    module = _settled(module, loss)
    value, slopes = _loss_and_slopes(module, loss)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        mixed_value, mixed_slopes = _loss_and_slopes(module, loss)
    assert mixed_value != value
    assert abs(mixed_value / value - 1) < 0.1
    flat, mixed = (
        torch.cat([part.flatten() for part in parts.values()]) for parts in (slopes, mixed_slopes)
    )
    assert torch.cosine_similarity(mixed, flat, dim=0) > cosine
    assert mixed.dtype == torch.float32
