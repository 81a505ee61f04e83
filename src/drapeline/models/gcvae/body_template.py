"""What a garment network is trained for: graphs, faces, statistics and the rest body of a shape."""

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
import torch

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.frames import GENDERS, REST_POSE
from drapeline.models.layers.precision import full_precision
from drapeline.registration.to_body.topology import TOPOLOGIES

SHAPES = 10
# cvar_s: shape, gender (0 female, 1 male), signed tightness.
STATIC_CVAR = SHAPES + 1 + 2


@dataclass(frozen=True)
class BodyTemplate:
    """Everything about body and data that a network is built on, as arrays.

    Attributes:
        edges: topology -> (E_l, 2) of each level.
        parents: topology -> (n_l,) of each level but the last.
        faces: topology -> (F, 3).
        offset_mean, offset_std: (V, 3) metres.
        base_mean, base_std: (V, 3) metres, of what offsets are added to.
        body_mean, body_std: (V, 3) metres, of the rest body.
        body_basis: (2 * 11, V, 3), `rest_basis`.
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

    def tensors(self) -> dict[str, torch.Tensor]:
        """Flat form for a checkpoint."""
        flat = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in _BY_TOPOLOGY}
        for name in TOPOLOGIES:
            flat[f"faces/{name}"] = self.faces[name]
            for key in ("edges", "parents"):
                for level, table in enumerate(getattr(self, key)[name]):
                    flat[f"{key}/{name}/{level}"] = table
        return {key: torch.from_numpy(np.ascontiguousarray(value)) for key, value in flat.items()}

    @classmethod
    def from_tensors(cls, tensors: Mapping[str, torch.Tensor]) -> "BodyTemplate":
        """The inverse of `tensors`."""
        flat = {key: value.cpu().numpy() for key, value in tensors.items()}

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


def rest_basis(bodies: Mapping[str, BodyModel]) -> np.ndarray:
    """(2 * 11, V, 3): rest body and its change per unit of each shape coefficient, per gender.

    In a fixed pose, joints and vertices are affine in shape, so this is exact.
    """
    basis = []
    for gender in GENDERS:
        shapes = np.vstack([np.zeros(SHAPES), np.eye(SHAPES)])
        posed = [posed_vertices(bodies[gender], s, REST_POSE[None])[0][0] for s in shapes]
        basis += [posed[0], *(p - posed[0] for p in posed[1:])]
    return np.stack(basis)


@full_precision
def rest_bodies(basis: torch.Tensor, cvar: torch.Tensor) -> torch.Tensor:
    """Rest bodies T, (V, 3, B), of conditions (B, C) that begin with shape and gender."""
    male = cvar[:, SHAPES : SHAPES + 1]
    one = torch.cat([torch.ones_like(male), cvar[:, :SHAPES]], 1)
    factors = torch.cat([one * (1 - male), one * male], 1)  # (B, 22)
    return (basis.flatten(1).T @ factors.T).unflatten(0, (-1, 3))
