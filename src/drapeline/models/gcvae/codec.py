"""Registered garments to codes and back: the interface of all models of this room, and its use."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np
import torch

from drapeline.dataset.record import SPLITS
from drapeline.metrics.gcvae import ACTIVE_VARIANCE
from drapeline.models.gcvae.data import BodyTemplate, Garments, StaticGarments
from drapeline.models.gcvae.networks import Code
from drapeline.models.training.batches import Batch, as_tensors
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.topology import TOPOLOGIES
from drapeline.settings import Settings
from drapeline.storage import load_npz, save_npz


@dataclass(frozen=True)
class TopologyBatch:
    """The samples of a batch that share a topology, in coordinate planes."""

    rows: torch.Tensor  # (B_t,) their places in the batch
    cvar: torch.Tensor  # (B_t, C) conditions
    offsets: torch.Tensor  # (V, 3, B_t) metres
    mask: torch.Tensor  # (V, B_t) bool

    @classmethod
    def of(cls, batch: Batch, rows: torch.Tensor) -> "TopologyBatch":
        """Some samples of a batch."""
        return cls(
            rows=rows,
            cvar=batch["cvar"][rows],
            offsets=planes(batch["offsets"][rows]),
            mask=batch["mask"][rows].T,
        )


Part = TypeVar("Part", bound=TopologyBatch)


class GarmentCodec(torch.nn.Module, ABC, Generic[Part]):
    """Garments to codes and back, given conditions.

    Args:
        settings: of `SETTINGS`, from which the codec can be built again.
        body_template: faces, statistics and rest bodies.

    Attributes:
        checkpoint_type: names the class in its checkpoints.
        model: its name in the table of metrics.
        resolves_penetration: whether decoded garments in motion are evened out and pushed out of
            the body, which the paper does not do.
        sees_frame: whether a garment in motion is rebuilt from its own code; one that is predicted
            is decoded from the mean of the prior alone.
    """

    checkpoint_type: ClassVar[str]
    model: ClassVar[str]
    SETTINGS: ClassVar[type[Settings]]
    resolves_penetration: ClassVar[bool] = False
    sees_frame: ClassVar[bool] = True
    offset_mean: torch.Tensor
    offset_std: torch.Tensor

    def __init__(self, settings: Any, body_template: BodyTemplate) -> None:
        super().__init__()
        self.settings, self.body_template = settings, body_template
        for moment in ("mean", "std"):
            self._constant(f"offset_{moment}")

    def _constant(self, name: str) -> None:
        table = torch.from_numpy(np.asarray(getattr(self.body_template, name), dtype=np.float32))
        self.register_buffer(name, table, persistent=False)

    # ---- what models do differently

    @property
    @abstractmethod
    def latent(self) -> int:
        """Numbers of a code."""

    @property
    @abstractmethod
    def seed(self) -> int:
        """Seed of whatever is drawn."""

    @abstractmethod
    def part(self, name: str, batch: Batch, rows: torch.Tensor) -> Part:
        """The samples of a batch in rows of topology `name`."""

    @abstractmethod
    def encode_parts(self, parts: Mapping[str, Part]) -> Code:
        """Codes in the order of the parts."""

    @abstractmethod
    def decode_parts(
        self, z: torch.Tensor, cvar: torch.Tensor, counts: Mapping[str, int]
    ) -> dict[str, torch.Tensor]:
        """Topology -> (V, 3 or 4, B_t) normalised offsets and any mask logit."""

    # ---- the same for all

    def parts(self, batch: Batch) -> dict[str, Part]:
        """The batch by topology; a topology without samples is left out."""
        rows = rows_by_topology(batch["topology"])
        return {name: self.part(name, batch, some) for name, some in rows.items()}

    @torch.no_grad()
    def encode(self, batch: Batch) -> Code:
        """Codes of the samples of a batch, in its order."""
        parts = self.parts(batch)
        code = self.encode_parts(parts)
        order = torch.argsort(torch.cat([part.rows for part in parts.values()]))
        return Code(*(x[order] for x in code))

    def decode(
        self, z: torch.Tensor, cvar: torch.Tensor, topology: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor | None]:
        """Garments from codes and conditions alone.

        Args:
            z: (B, latent).
            cvar: (B, C) conditions.
            topology: (B,) codes of `TOPOLOGIES`.

        Returns:
            Offsets (B, V, 3) in metres, and the mask's probability (B, V) or None if the model
            has none.
        """
        rows = rows_by_topology(topology)
        order = torch.cat(list(rows.values()))
        counts = {name: len(part) for name, part in rows.items()}
        parts = self.decode_parts(z[order], cvar[order], counts)
        back = torch.argsort(order)
        metres = [self.to_metres(part[:, :3], name) for name, part in parts.items()]
        offsets = torch.cat(metres, 2)[..., back].permute(2, 0, 1)
        logit = torch.cat([part[:, 3:] for part in parts.values()], 2)[..., back]
        return offsets, torch.sigmoid(logit[:, 0]).T if logit.shape[1] else None

    def normalise_offsets(self, offsets: torch.Tensor, name: str) -> torch.Tensor:
        """(V, 3, B) metres -> deviations, per vertex, from what is usual for topology `name`."""
        mean, std = self.offset_moments(name)
        return (offsets - mean) / std

    def to_metres(self, normalised: torch.Tensor, name: str) -> torch.Tensor:
        """(V, 3, B) normalised offsets of topology `name` -> metres."""
        mean, std = self.offset_moments(name)
        return normalised * std + mean

    def offset_moments(self, name: str) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean and deviation (V, 3, 1) of the offsets of topology `name`, metres."""
        code = TOPOLOGIES.index(name)
        return self.offset_mean[code, ..., None], self.offset_std[code, ..., None]

    def checkpoint_metadata(self) -> dict[str, Any]:
        """Everything needed to build it again, as plain values and tensors."""
        return {
            "checkpoint_type": self.checkpoint_type,
            "settings": self.settings.plain(),
            "body_template": self.body_template.tensors(),
        }


def rows_by_topology(topology: torch.Tensor) -> dict[str, torch.Tensor]:
    """Topology -> its places among codes (B,) of `TOPOLOGIES`; those without any are left out."""
    rows = {name: torch.nonzero(topology == code)[:, 0] for code, name in enumerate(TOPOLOGIES)}
    return {name: some for name, some in rows.items() if len(some)}


def conditions_of(parts: Mapping[str, TopologyBatch]) -> tuple[torch.Tensor, dict[str, int]]:
    """Conditions (B, C) in the order of the parts, and how many samples each part has."""
    cvar = torch.cat([part.cvar for part in parts.values()])
    return cvar, {name: len(part.rows) for name, part in parts.items()}


def planes(x: torch.Tensor) -> torch.Tensor:
    """(B, V, C) -> (V, C, B), contiguous."""
    return x.flatten(1).T.contiguous().unflatten(0, (x.shape[1], -1))


def kl_nat(mean: torch.Tensor, log_variance: torch.Tensor) -> torch.Tensor:
    """(B, Z) each -> (B,): KL of the normal posterior from the standard normal, summed over z."""
    return 0.5 * (mean**2 + log_variance.exp() - 1 - log_variance).sum(1)


_BATCH = 16


class Codes(NamedTuple):
    """Posteriors of (n,) garments: mean and log_variance (n, Z) float32."""

    mean: np.ndarray
    log_variance: np.ndarray

    def kl_nat(self) -> np.ndarray:
        """(n,) divergence of each from the standard normal, in nats."""
        return kl_nat(*map(torch.from_numpy, self)).numpy()

    def active_units(self) -> int:
        """Components whose mean varies over the garments by more than `ACTIVE_VARIANCE`."""
        return int((self.mean.var(axis=0) > ACTIVE_VARIANCE).sum())

    def of(self, rows: np.ndarray) -> "Codes":
        """Codes of some rows."""
        return Codes(self.mean[rows], self.log_variance[rows])


def join_codes(parts: Sequence[Codes]) -> Codes:
    """Codes of several parts, one after the other."""
    mean, log_variance = (np.concatenate(half) for half in zip(*parts, strict=True))
    return Codes(mean, log_variance)


def encode_rows(
    model: GarmentCodec, read: Callable[[np.ndarray], Batch], rows: Sequence[int] | np.ndarray
) -> Codes:
    """Codes of rows that are read a batch at a time, in their order."""
    parts = []
    for start in range(0, len(rows), _BATCH):
        code = model.encode(as_tensors(read(np.asarray(rows[start : start + _BATCH]))))
        parts.append(Codes(code.mean.numpy(), code.log_variance.numpy()))
    return join_codes(parts)


def encode_garments(
    model: GarmentCodec, garments: Garments, rows: Sequence[int] | np.ndarray
) -> Codes:
    """Codes of rows of a dataset, in their order."""
    return encode_rows(model, garments.batch, rows)


def encode_held_out(model: GarmentCodec, garments: Garments, training: Codes) -> Codes:
    """Codes of all rows of a dataset, given those of its training rows in their order."""
    trained, *others = (garments.rows(split) for split in SPLITS)
    held_out = np.concatenate(others)
    parts = (training, encode_garments(model, garments, held_out))
    order = np.argsort(np.concatenate([trained, held_out]))
    return Codes(*(np.concatenate(half)[order] for half in zip(*parts, strict=True)))


def decode_codes(
    model: GarmentCodec, z: np.ndarray, cvar: np.ndarray, topology: np.ndarray
) -> Iterator[tuple[np.ndarray, Any]]:
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


# Of a static model's evaluation.
CODES = "codes.npz"


def save_codes(path: str | Path, codes: Codes, garments: StaticGarments) -> None:
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
