"""Garments as the models take them, and the body template that networks are built on."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np
import torch

from drapeline.bodies.kinematics import mirror_poses
from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import SHAPES, rest_basis
from drapeline.learning_data.dynamic import DynamicData
from drapeline.learning_data.static import StaticData
from drapeline.learning_data.vertex_moments import body_statistics, offset_statistics
from drapeline.models.layers.linear import full_precision
from drapeline.models.training.batches import Batch, refuse_unfinite
from drapeline.npy import HeaderError, check_arrays
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.hierarchy import Hierarchy
from drapeline.registration.to_body.super_body import mirror_of
from drapeline.registration.to_body.topology import TOPOLOGIES, Topology, topology_codes


@dataclass(frozen=True)
class BodyTemplate:
    """Everything about the body and the training data that a network is built on, as arrays."""

    edges: Mapping[str, list[np.ndarray]]  # topology -> (E_l, 2) of each level
    parents: Mapping[str, list[np.ndarray]]  # topology -> (n_l,) of each level but the last
    faces: Mapping[str, np.ndarray]  # topology -> (F, 3)
    # offset_mean, offset_std: (T, V, 3) metres, of each of `TOPOLOGIES`.
    offset_mean: np.ndarray
    offset_std: np.ndarray
    # base_mean, base_std: (V, 3) metres, of what offsets are added to.
    base_mean: np.ndarray
    base_std: np.ndarray
    # body_mean, body_std: (V, 3) metres, of the rest body.
    body_mean: np.ndarray
    body_std: np.ndarray
    body_basis: np.ndarray  # (2 * 11, V, 3), see `drapeline.bodies.rest_body.rest_basis`
    # cvar_mean, cvar_std: (C,).
    cvar_mean: np.ndarray
    cvar_std: np.ndarray

    def faces_of(self, garment: str) -> np.ndarray:
        """(F, 3) faces of the topology of a garment type, one of `GARMENTS`."""
        (code,) = topology_codes(np.array([GARMENTS.index(garment)]))
        return self.faces[TOPOLOGIES[int(code)]]

    @property
    def mirror(self) -> np.ndarray | None:
        """(V,) vertices of the body that lie opposite; None if it is not symmetric."""
        return mirror_of(self.body_mean.astype(np.float64), self.faces["body"])

    def rest_body(self, cvar: np.ndarray) -> np.ndarray:
        """(V, 3) float32 rest body of one set of conditions (C,), metres."""
        basis = torch.from_numpy(self.body_basis)
        return rest_bodies(basis, torch.from_numpy(cvar.astype(np.float32))[None])[..., 0].numpy()

    def tensors(self) -> dict[str, torch.Tensor]:
        """As a flat mapping, for a checkpoint."""
        flat = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in _BY_TOPOLOGY}
        for name in TOPOLOGIES:
            flat[f"faces/{name}"] = self.faces[name]
            for key in ("edges", "parents"):
                for level, table in enumerate(getattr(self, key)[name]):
                    flat[f"{key}/{name}/{level}"] = table
        return {key: torch.from_numpy(np.ascontiguousarray(value)) for key, value in flat.items()}

    @classmethod
    def from_tensors(cls, tensors: Mapping[str, torch.Tensor]) -> "BodyTemplate":
        """The inverse of `tensors`.

        Raises:
            HeaderError: an array is missing or not as it has to be; names it.
        """
        flat = {key: value.cpu().numpy() for key, value in tensors.items()}
        _check(flat)

        def levels(key: str, name: str) -> list[np.ndarray]:
            count = sum(k.startswith(f"{key}/{name}/") for k in flat)
            return [flat[f"{key}/{name}/{level}"] for level in range(count)]

        return cls(
            edges={name: levels("edges", name) for name in TOPOLOGIES},
            parents={name: levels("parents", name) for name in TOPOLOGIES},
            faces={name: flat[f"faces/{name}"] for name in TOPOLOGIES},
            **{f.name: flat[f.name] for f in fields(cls) if f.name not in _BY_TOPOLOGY},
        )


_BY_TOPOLOGY = ("edges", "parents", "faces")

_STATISTICS = {
    **dict.fromkeys(("offset_mean", "offset_std"), f"float {len(TOPOLOGIES)} v 3"),
    **dict.fromkeys(("base_mean", "base_std"), "float v 3"),
    **dict.fromkeys(("body_mean", "body_std"), "float v 3"),
    "body_basis": f"float {2 * (SHAPES + 1)} v 3",
    **dict.fromkeys(("cvar_mean", "cvar_std"), "float c"),
}


def _check(flat: Mapping[str, np.ndarray]) -> None:
    """Nodes are named by indices, so graphs cannot be built of what does not fit together."""
    table, sizes = dict(_STATISTICS), {}
    for name in TOPOLOGIES:
        count = sum(key.startswith(f"edges/{name}/") for key in flat)
        nodes = ["v", *(f"{name}{level}" for level in range(1, count))]
        table[f"faces/{name}"] = "int<v * 3"
        table |= {f"edges/{name}/{k}": f"int<{nodes[k]} * 2" for k in range(count)}
        table |= {f"parents/{name}/{k}": f"int<{nodes[k + 1]} {nodes[k]}" for k in range(count - 1)}
        if count < 2:
            raise HeaderError(f"'edges/{name}' has {count} levels, expected two or more")
        last = flat.get(f"parents/{name}/{count - 2}", np.zeros(0, int))
        # Every node of the last level has children, which are no fewer.
        if last.dtype.kind in "iu":
            sizes[nodes[-1]] = min(int(last.max()) + 1, last.size) if last.size else 0
    check_arrays(flat, table, **sizes)


@full_precision
def rest_bodies(basis: torch.Tensor, cvar: torch.Tensor) -> torch.Tensor:
    """Rest bodies T (V, 3, B), metres, of conditions (B, C) that begin with shape and gender."""
    male = cvar[:, SHAPES : SHAPES + 1]
    one = torch.cat([torch.ones_like(male), cvar[:, :SHAPES]], 1)
    factors = torch.cat([one * (1 - male), one * male], 1)  # (B, 22)
    return (basis.flatten(1).T @ factors.T).unflatten(0, (-1, 3))


def cvar_statistics(cvar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and deviation (C,) float32 of the conditions (n, C) of the training rows.

    A condition that hardly varies in training has deviation 1, since it may vary elsewhere.
    """
    std = cvar.std(axis=0)
    return cvar.mean(axis=0).astype(np.float32), np.where(std > 0.05, std, 1).astype(np.float32)


class Garments(Protocol):
    """Registered garments with conditions, as models are trained on them and encode them."""

    def rows(self, split: str) -> np.ndarray:
        """Indices of the rows of a split."""

    def topology(self, rows: np.ndarray) -> np.ndarray:
        """(n,) codes of `TOPOLOGIES`."""

    def cvar(self, rows: np.ndarray) -> np.ndarray:
        """(n, C) conditions."""

    def batch(self, rows: np.ndarray) -> Batch:
        """`offsets` (B, V, 3), `mask` (B, V), `cvar` (B, C), `topology` (B,) and `names`.

        Garments in motion also have `base` (B, V, 3), what their offsets are added to.
        """


class StaticGarments(Garments, Protocol):
    """Registered garments in rest pose, as encoding and evaluation read them.

    Attributes:
        offsets: (N, V, 3) metres.
        mask: (N, V) bool.
        garment: (N,) types, indices into `GARMENTS`.
        outfit: (N,) names.
    """

    offsets: np.ndarray
    mask: np.ndarray
    garment: np.ndarray
    outfit: np.ndarray


class DynamicGarments:
    """Rows of a `DynamicData` with their conditions: up to 4 poses and static codes z_s (G, Z)."""

    def __init__(self, data: DynamicData, codes: np.ndarray, frames: int) -> None:
        self.data, self.codes, self.frames = data, codes, frames

    def rows(self, split: str) -> np.ndarray:
        """Indices of the frames of a split."""
        return self.data.rows(split)

    def topology(self, rows: np.ndarray) -> np.ndarray:
        """(n,) codes of `TOPOLOGIES`."""
        return self.data.topology(rows)

    def cvar(self, rows: np.ndarray, poses: np.ndarray | None = None) -> np.ndarray:
        """(n, 13 + 72 f + Z) float32: static conditions, poses, static code.

        Args:
            poses: (n, f or more, 72) rad float32, newest first, in place of those of the rows.
        """
        poses = (self.data.poses[rows] if poses is None else poses)[:, : self.frames]
        garments = self.data.garment_index[rows]
        flat = poses.reshape(len(rows), -1)
        return np.concatenate([self.data.cvar(garments), flat, self.codes[garments]], 1)

    def mirrored_cvar(self, rows: np.ndarray) -> np.ndarray:
        """(n, 13 + 72 f + Z) float32: conditions of the rows' mirror images.

        Their static codes are those of the rows: garments are symmetric in rest pose.
        """
        return self.cvar(rows, mirror_poses(self.data.poses[rows]))

    def names(self, rows: np.ndarray) -> list[str]:
        """Sample, garment and frame of rows, for messages."""
        data = self.data
        return [
            f"{data.sample[g]}/{GARMENTS[data.garment[g]]}/{frame}"
            for g, frame in zip(data.garment_index[rows], data.frame[rows], strict=True)
        ]

    def batch(self, rows: np.ndarray) -> Batch:
        """Arrays of rows."""
        data, garments = self.data, self.data.garment_index[rows]
        return {
            "offsets": np.asarray(data.offsets[rows]),
            "base": np.asarray(data.base[rows]),
            "mask": np.asarray(data.mask[garments]),
            "cvar": self.cvar(rows),
            "topology": self.topology(rows),
            "names": self.names(rows),
        }


def offset_moments(
    read: Callable[[int], tuple[np.ndarray, np.ndarray]],
    rows: np.ndarray,
    topology: np.ndarray,
    names: Callable[[np.ndarray], list[str]],
    *,
    of_each: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and deviation (T, V, 3) of the offsets of rows, where there is a garment.

    Where trousers have legs skirts have cloth that is nowhere near, so what is usual for all
    garments together is usual for neither.

    Args:
        read: row -> offsets (V, 3) in metres and mask (V,).
        rows: (n,) to read.
        topology: (n,) codes of `TOPOLOGIES`.
        names: of rows, for messages.
        of_each: whether a topology has its own; one without rows has those of all, as all have
            otherwise.

    Raises:
        InputError: offsets are not finite; names the sample.
    """

    def checked(row: int) -> tuple[np.ndarray, np.ndarray]:
        offsets, mask = read(row)
        refuse_unfinite(offsets[None], names(np.array([row])), "offsets")
        return offsets, mask

    codes = range(len(TOPOLOGIES))
    own = [rows[topology == code] if of_each else rows[:0] for code in codes]
    shared = None if all(map(len, own)) else offset_statistics(map(checked, rows))
    parts = [offset_statistics(map(checked, part)) if len(part) else shared for part in own]
    mean, std = (np.stack(moment) for moment in zip(*filter(None, parts), strict=True))
    return mean, std


def static_body_template(
    data: StaticData,
    topology: Topology,
    hierarchy: Hierarchy,
    bodies: Mapping[str, BodyModel],
    *,
    of_each: bool = True,
) -> BodyTemplate:
    """Statistics of the training rows; offsets are added to the rest body.

    Args:
        data: registered garments in rest pose.
        topology, hierarchy: of the super-resolved bodies.
        bodies: super-resolved, by gender.
        of_each: see `offset_moments`.
    """
    rows = data.rows("train")
    cvar_mean, cvar_std = cvar_statistics(data.cvar(rows))
    offset_mean, offset_std = offset_moments(
        lambda row: (data.offsets[row], data.mask[row]),
        rows,
        data.topology(rows),
        data.names,
        of_each=of_each,
    )
    return BodyTemplate(
        edges=hierarchy.edges,
        parents=hierarchy.parents,
        faces={"body": topology.faces, "skirt": topology.skirt_faces},
        offset_mean=offset_mean,
        offset_std=offset_std,
        base_mean=data.body_mean,
        base_std=data.body_std,
        body_mean=data.body_mean,
        body_std=data.body_std,
        body_basis=rest_basis(bodies),
        cvar_mean=cvar_mean,
        cvar_std=cvar_std,
    )


def dynamic_body_template(
    garments: DynamicGarments,
    topology: Topology,
    hierarchy: Hierarchy,
    bodies: Mapping[str, BodyModel],
    *,
    of_each: bool = True,
) -> BodyTemplate:
    """Statistics of the training frames, and of the rest bodies of their samples.

    Args:
        garments: frames with their conditions.
        topology, hierarchy: of the super-resolved bodies.
        bodies: super-resolved, by gender.
        of_each: see `offset_moments`.
    """
    data, rows = garments.data, garments.rows("train")
    cvar_mean, cvar_std = cvar_statistics(garments.cvar(rows))
    offset_mean, offset_std = offset_moments(
        lambda row: (data.offsets[row], data.mask[data.garment_index[row]]),
        rows,
        garments.topology(rows),
        garments.names,
        of_each=of_each,
    )
    base_mean, base_std = body_statistics(data.base[row] for row in rows)
    basis = rest_basis(bodies)
    static_cvar = torch.from_numpy(data.cvar(np.unique(data.garment_index[rows])))
    rest = rest_bodies(torch.from_numpy(basis), static_cvar).permute(2, 0, 1).numpy()
    body_mean, body_std = body_statistics(rest)
    return BodyTemplate(
        edges=hierarchy.edges,
        parents=hierarchy.parents,
        faces={"body": topology.faces, "skirt": topology.skirt_faces},
        offset_mean=offset_mean,
        offset_std=offset_std,
        base_mean=base_mean,
        base_std=base_std,
        body_mean=body_mean,
        body_std=body_std,
        body_basis=basis,
        cvar_mean=cvar_mean,
        cvar_std=cvar_std,
    )
