"""Muon for matrices beside Adam for all other parameters, as one optimiser."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import torch

# Of a polynomial that is steep at 0, and five rounds of it, as Keller Jordan found them.
_COEFFICIENTS = (3.4445, -4.7750, 2.0315)
_ROUNDS = 5
_SMALLEST = 1e-7


class Muon(torch.optim.Optimizer):
    """Muon (Jordan et al. 2024), with the step sizes of Liu et al. 2025, in single precision.

    Like `torch.optim.Muon` with Nesterov momentum, `adjust_lr_fn="match_rms_adamw"` and no weight
    decay. That one computes in bfloat16, which takes processors without instructions for it more
    than ten times as long.

    Args:
        params: matrices, or groups of them.
        lr: learning rate, as Adam's would be.
        momentum: share of the mean gradient that is kept.
    """

    def __init__(self, params: Iterable[Any], lr: float, momentum: float = 0.95) -> None:
        super().__init__(params, {"lr": lr, "momentum": momentum})

    @torch.no_grad()
    def step(self, closure: None = None) -> None:
        """One step of all matrices that have a gradient."""
        for group in self.param_groups:
            for matrix in group["params"]:
                if matrix.grad is None:
                    continue
                state = self.state[matrix]
                if not state:
                    state["momentum_buffer"] = torch.zeros_like(matrix)
                mean = state["momentum_buffer"].lerp_(matrix.grad, 1 - group["momentum"])
                way = orthogonalise(matrix.grad.lerp(mean, group["momentum"]))
                matrix.add_(way, alpha=-0.2 * max(matrix.shape) ** 0.5 * group["lr"])


def orthogonalise(matrix: torch.Tensor) -> torch.Tensor:
    """A matrix (A, B) with about the same singular vectors whose singular values are near 1.

    Newton-Schulz iterations as in Muon: values of .01 of the matrix's norm and more end between .5
    and 1.3.
    """
    if matrix.shape[0] > matrix.shape[1]:
        return orthogonalise(matrix.T).T
    a, b, c = _COEFFICIENTS
    found = matrix / matrix.norm().clamp(min=_SMALLEST)
    for _ in range(_ROUNDS):
        gram = found @ found.T
        gram = torch.addmm(gram, gram, gram, beta=b, alpha=c)
        found = torch.addmm(found, gram, found, beta=a)
    return found


class JointOptimizer(torch.optim.Optimizer):
    """Several optimisers that step together, for trainers that take a single one.

    Args:
        parts: of disjoint parameters.
    """

    def __init__(self, parts: Sequence[torch.optim.Optimizer]) -> None:
        self.parts = list(parts)
        super().__init__([p for part in parts for g in part.param_groups for p in g["params"]], {})
        self._share_groups()

    def _share_groups(self) -> None:
        # The very groups of the parts, so that a learning rate set here is theirs.
        self.param_groups = [group for part in self.parts for group in part.param_groups]

    def step(self, closure: Callable[[], Any] | None = None) -> Any:
        """One step of each."""
        loss = None
        if closure is not None:
            with torch.enable_grad():
                loss = closure()
        for part in self.parts:
            part.step()
        return loss

    def state_dict(self) -> dict[str, Any]:
        """Those of the parts."""
        return {"parts": [part.state_dict() for part in self.parts]}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Into the parts."""
        for part, state in zip(self.parts, state_dict["parts"], strict=True):
            part.load_state_dict(state)
        self._share_groups()
