"""Optimisers: of networks, Muon beside Adam; of codes, least squares and Adam, with a prior."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch

# Of a polynomial that is steep at 0, and five rounds of it, as Keller Jordan found them.
_COEFFICIENTS = (3.4445, -4.7750, 2.0315)
_ROUNDS = 5
_SMALLEST = 1e-7
_EASE = 1e-3  # of the codes' mean variance, added to all: there may be few of them
_DAMPING, _MORE, _LESS, _LEAST_DAMPING = 0.1, 10.0, 3.0, 1e-6


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
    def step(self, closure: Any = None) -> Any:
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
    """Optimisers of disjoint parameters that step together, for trainers that take a single one."""

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


class CosineAdam:
    """Adam on some numbers, with a learning rate that falls to zero like a cosine.

    Args:
        start: of the numbers.
        rate: the first learning rate.
        steps: that are going to be taken.

    Attributes:
        x: the numbers as they are now, like `start`.
    """

    def __init__(self, start: torch.Tensor, *, rate: float, steps: int) -> None:
        self.x = start.detach().clone().requires_grad_(True)
        self._adam = torch.optim.Adam([self.x], lr=rate)
        self._schedule = torch.optim.lr_scheduler.CosineAnnealingLR(self._adam, steps)

    def step(self, loss: Callable[[torch.Tensor], torch.Tensor]) -> None:
        """One step down the sum of a loss of the numbers."""
        (self.x.grad,) = torch.autograd.grad(loss(self.x).sum(), self.x)
        self._adam.step()
        self._schedule.step()


class Linearised(NamedTuple):
    """Least squares of B fits, each with Z unknowns and P residuals, around where they are now."""

    residual: torch.Tensor  # (B, P)
    slopes: torch.Tensor  # (B, P, Z) derivatives of the residuals
    weight: torch.Tensor  # (B, P) of their squares
    prior: torch.Tensor  # (B, Z) of the squares of the unknowns themselves
    loss: torch.Tensor  # (B,) what has to become less, which the squares stand for


def fit_least_squares(
    x: torch.Tensor, linearise: Callable[[torch.Tensor], Linearised], steps: int
) -> torch.Tensor:
    """(B, Z) unknowns by damped Gauss-Newton steps (Levenberg 1944, Marquardt 1963).

    A step that makes the loss greater is taken back, so no fit ends worse than it started.

    Args:
        x: (B, Z) to start from.
        linearise: the squares at some unknowns, which may be weighted anew at each (iteratively
            reweighted least squares).
        steps: how often it is called again.
    """
    here, damping = linearise(x), x.new_full((len(x), 1), _DAMPING)
    for _ in range(steps):
        tried_x = x - _damped_step(here, x, damping)
        tried = linearise(tried_x)
        better = tried.loss < here.loss
        damping = torch.where(better[:, None], damping / _LESS, damping * _MORE)
        x = torch.where(better[:, None], tried_x, x)
        chosen = (
            torch.where(better.view(-1, *[1] * (new.ndim - 1)), new, old)
            for new, old in zip(tried, here, strict=True)
        )
        here = Linearised(*chosen)
    return x


def _damped_step(here: Linearised, x: torch.Tensor, damping: torch.Tensor) -> torch.Tensor:
    """(B, Z) the way from the solution of the damped normal equations to the unknowns."""
    weighted = (here.weight[..., None] * here.slopes).mT
    normal = weighted @ here.slopes + torch.diag_embed(here.prior)
    right = (weighted @ here.residual[..., None])[..., 0] + here.prior * x
    diagonal = normal.diagonal(dim1=1, dim2=2)
    damped = normal + torch.diag_embed(damping * diagonal + _LEAST_DAMPING)
    return torch.linalg.solve_ex(damped, right).result


class CodePrior(NamedTuple):
    """The spread of the codes of some garments: z = mean + factor w.

    Codes are not spread alike in all directions; w is, with a mean square of one.
    """

    mean: torch.Tensor  # (Z,)
    factor: torch.Tensor  # (Z, Z) lower triangle

    @classmethod
    def of(cls, codes: np.ndarray) -> "CodePrior":
        """The prior of training codes (n, Z), in single precision."""
        z = np.asarray(codes, dtype=np.float64)
        covariance = np.cov(z.T, bias=True)
        covariance += (
            _EASE * max(np.trace(covariance) / len(covariance), 1e-6) * np.eye(len(covariance))
        )
        factor = np.linalg.cholesky(covariance)
        return cls(
            *(torch.from_numpy(part.astype(np.float32)) for part in (z.mean(axis=0), factor))
        )

    def codes(self, w: torch.Tensor) -> torch.Tensor:
        """(B, Z) codes of w (B, Z)."""
        return self.mean + w @ self.factor.T

    def whiten(self, z: torch.Tensor) -> torch.Tensor:
        """(B, Z) w of codes (B, Z)."""
        return torch.linalg.solve_triangular(self.factor, (z - self.mean).T, upper=False).T


def spread_codes(codes: np.ndarray, count: int) -> np.ndarray:
    """(m, Z) the mean of codes (n, Z) and `count` of them that are far from one another."""
    mean = codes.mean(axis=0)
    chosen, away = [mean], np.linalg.norm(codes - mean, axis=1)
    for _ in range(min(count, len(codes))):
        chosen.append(codes[int(away.argmax())])
        away = np.minimum(away, np.linalg.norm(codes - chosen[-1], axis=1))
    return np.stack(chosen).astype(np.float32)
