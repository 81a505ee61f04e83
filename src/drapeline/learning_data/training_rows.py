"""Rows that linear models are fitted to, the same for all of them, and rows that errors are of."""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from drapeline.seeding import rng_for

LINEAR_ROWS_MAX = 2000


class MirroredGarments(Protocol):
    """Registered garments whose mirror images are garments as well."""

    def rows(self, split: str) -> np.ndarray:
        """Indices of the rows of a split."""

    def batch(self, rows: np.ndarray) -> dict[str, Any]:
        """`offsets` (B, V, 3), `mask` (B, V), `cvar` (B, C) and others."""

    def mirrored_cvar(self, rows: np.ndarray) -> np.ndarray:
        """(n, C) conditions of the rows' mirror images."""


def linear_rows(garments: MirroredGarments, split: str, seed: int) -> np.ndarray:
    """(n,) rows of a split, rising; of more than `LINEAR_ROWS_MAX`, so many that the seed draws."""
    rows = garments.rows(split)
    if len(rows) > LINEAR_ROWS_MAX:
        rng = rng_for(seed, "linear rows")
        rows = np.sort(rng.choice(rows, LINEAR_ROWS_MAX, replace=False))
    return rows


def with_mirror_images(
    garments: MirroredGarments, rows: np.ndarray, mirror: np.ndarray | None
) -> list[dict[str, Any]]:
    """The batch of rows, and that of their mirror images: a garment's is a garment too.

    Args:
        mirror: (V,) vertices opposite; None if the body is not symmetric, and then there are none.
    """
    batch = garments.batch(rows)
    if mirror is None:
        return [batch]
    return [batch, {**mirror_batch(batch, mirror), "cvar": garments.mirrored_cvar(rows)}]


def mirror_batch(batch: dict[str, Any], mirror: np.ndarray) -> dict[str, Any]:
    """Exchange left and right in the offsets and masks of a batch, by vertices (V,) opposite."""
    flip = np.array([-1, 1, 1], dtype=np.float32)
    return {
        **batch,
        "offsets": batch["offsets"][:, mirror] * flip,
        "mask": batch["mask"][:, mirror],
    }


def rows_like(kinds: Sequence[Any] | np.ndarray, wanted: Sequence[Any] | np.ndarray) -> np.ndarray:
    """Indices, rising, of at most as many of each kind as `wanted` has, evenly spaced.

    Spaced over all kinds at once, they would fall into step with kinds that take turns.

    Args:
        kinds: (n,) such as the types of garments.
        wanted: (m,) kinds.
    """
    kinds, wanted = np.asarray(kinds), np.asarray(wanted)
    chosen = []
    for kind in np.unique(wanted):
        own = np.flatnonzero(kinds == kind)
        count = min(len(own), int((wanted == kind).sum()))
        chosen.append(own[np.linspace(0, len(own) - 1, count).round().astype(int)])
    return np.sort(np.concatenate(chosen)) if chosen else np.zeros(0, dtype=np.int64)
