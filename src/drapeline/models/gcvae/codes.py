"""Datasets of garments through trained VAEs: to codes, and from codes back to garments."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch

from drapeline.dataset.splits import SPLITS
from drapeline.models.gcvae.codec import GarmentCodec, Garments
from drapeline.models.gcvae.loss import kl_nat
from drapeline.models.training.batches import as_tensors
from drapeline.outfits.garment_types import GARMENTS
from drapeline.storage import load_npz, save_npz

if TYPE_CHECKING:  # a training does not depend on how its results are measured
    from drapeline.metrics.registered import Prediction, StaticRows

_BATCH = 16


class Codes(NamedTuple):
    """Posteriors of (n,) garments.

    Attributes:
        mean, log_variance: (n, Z) float32.
    """

    mean: np.ndarray
    log_variance: np.ndarray

    def kl_nat(self) -> np.ndarray:
        """(n,) divergence of each from the standard normal, in nats."""
        return kl_nat(*map(torch.from_numpy, self)).numpy()

    def of(self, rows: np.ndarray) -> "Codes":
        """Codes of some rows."""
        return Codes(self.mean[rows], self.log_variance[rows])


def encode_garments(model: GarmentCodec, garments: Garments, rows: Sequence[int]) -> Codes:
    """Codes of rows of a dataset, in their order."""
    means, log_variances = [], []
    for start in range(0, len(rows), _BATCH):
        part = np.asarray(rows[start : start + _BATCH])
        batch = as_tensors(garments.batch(part))
        code = model.encode(batch)
        means.append(code.mean.numpy())
        log_variances.append(code.log_variance.numpy())
    return Codes(np.concatenate(means), np.concatenate(log_variances))


def encode_held_out(model: GarmentCodec, garments: Garments, training: Codes) -> Codes:
    """Codes of all rows of a dataset, given those of its training rows in their order."""
    trained, *others = (garments.rows(split) for split in SPLITS)
    held_out = np.concatenate(others)
    parts = (training, encode_garments(model, garments, held_out))
    order = np.argsort(np.concatenate([trained, held_out]))
    return Codes(*(np.concatenate(half)[order] for half in zip(*parts, strict=True)))


def decode_codes(
    model: GarmentCodec, z: np.ndarray, cvar: np.ndarray, topology: np.ndarray
) -> Iterator["Prediction"]:
    """Garments of codes, one by one: offsets (V, 3) in metres, and mask (V,) or None.

    Args:
        z: (n, Z).
        cvar: (n, C) conditions.
        topology: (n,) codes of `TOPOLOGIES`.
    """
    for start in range(0, len(z), _BATCH):
        part = slice(start, start + _BATCH)
        with torch.inference_mode():
            offsets, mask = model.decode(
                *(
                    torch.from_numpy(np.ascontiguousarray(x[part], dtype=dtype))
                    for x, dtype in ((z, np.float32), (cvar, np.float32), (topology, np.int64))
                )
            )
        inside = [None] * len(offsets) if mask is None else (mask > 0.5).numpy()
        yield from zip(offsets.numpy(), inside, strict=True)


def save_codes(path: str | Path, codes: Codes, garments: "StaticRows") -> None:
    """Write the codes of all rows with their `garment`, `outfit` and `split`."""
    split = np.full(len(garments.garment), "", dtype="U5")
    for name in SPLITS:
        split[garments.rows(name)] = name
    save_npz(
        path,
        mean=codes.mean,
        log_variance=codes.log_variance,
        garment=np.asarray(garments.garment),
        outfit=np.asarray(garments.outfit),
        split=split,
    )


_ARRAYS = {
    **dict.fromkeys(("mean", "log_variance"), "float n z"),
    "garment": f"int<{len(GARMENTS)} n",
    **dict.fromkeys(("outfit", "split"), "str n"),
}


def load_codes(path: str | Path) -> tuple[Codes, dict[str, np.ndarray]]:
    """Codes (N, Z), and `garment`, `outfit` and `split` (N,) of the same rows.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    about = load_npz(path, _ARRAYS)
    return Codes(about.pop("mean"), about.pop("log_variance")), about
