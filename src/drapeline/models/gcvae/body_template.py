"""The body that garment networks are built on: graphs, faces, statistics and rest bodies."""

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
import torch

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.rest_body import SHAPES
from drapeline.frames import GENDERS, REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.models.layers.linear import full_precision
from drapeline.npy import HeaderError, check_arrays
from drapeline.registration.to_body.topology import TOPOLOGIES, topology_codes

# cvar_s: shape, gender (0 female, 1 male), signed tightness.
STATIC_CVAR = SHAPES + 1 + 2


@dataclass(frozen=True)
class BodyTemplate:
    """Everything about the body and the training data that a network is built on, as arrays.

    Attributes:
        edges: topology -> (E_l, 2) of each level.
        parents: topology -> (n_l,) of each level but the last.
        faces: topology -> (F, 3).
        offset_mean, offset_std: (V, 3) metres.
        base_mean, base_std: (V, 3) metres, of what offsets are added to.
        body_mean, body_std: (V, 3) metres, of the rest body.
        body_basis: (2 * 11, V, 3), see `drapeline.bodies.rest_body.rest_basis`.
        cvar_mean, cvar_std: (C,).
    """

    edges: Mapping[str, list[np.ndarray]]
    parents: Mapping[str, list[np.ndarray]]
    faces: Mapping[str, np.ndarray]
    offset_mean: np.ndarray
    offset_std: np.ndarray
    base_mean: np.ndarray
    base_std: np.ndarray
    body_mean: np.ndarray
    body_std: np.ndarray
    body_basis: np.ndarray
    cvar_mean: np.ndarray
    cvar_std: np.ndarray

    def faces_of(self, garment_index: int) -> np.ndarray:
        """(F, 3) faces of the topology of a garment type, an index into `GARMENTS`."""
        (code,) = topology_codes(np.array([garment_index]))
        return self.faces[TOPOLOGIES[int(code)]]

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
    **dict.fromkeys(("offset_mean", "offset_std", "base_mean", "base_std"), "float v 3"),
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


def wearer_mesh(bodies: Mapping[str, BodyModel], cvar: np.ndarray) -> Mesh:
    """The whole rest body, with head, hands and feet, of static conditions.

    Args:
        bodies: whole bodies, by gender.
        cvar: (13,); a gender between 0 (female) and 1 (male) gives a body between the two.
    """
    female, male = (posed_vertices(bodies[g], cvar[:10], REST_POSE[None])[0][0] for g in GENDERS)
    return Mesh(female + cvar[10] * (male - female), bodies[GENDERS[0]].faces)
