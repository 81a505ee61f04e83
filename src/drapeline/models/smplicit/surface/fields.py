"""Distance fields around a body: what one is, the trained network's, and where cloth can be."""

from typing import Protocol

import numpy as np
import torch
from scipy.spatial import KDTree

from drapeline.frames import GENDERS
from drapeline.models.smplicit.garments import Box
from drapeline.models.smplicit.network import GarmentField

# Points at once: activations of so many stay in the processor's cache.
_BATCH = 1024
# No garment at rest is further from the body; the widest skirts are 30 cm from the legs.
REACH_M = 0.35
_BLOCK_M = 0.06
_LEAF = 32  # vertices in a tree's leaf; for points far from all of them twice as fast as 10


class DistanceField(Protocol):
    """Distances from points in space to a garment's surface, exact or learned.

    A learned field is clipped at `clip_m`, the distance it was trained up to, may be slightly
    negative close to the surface, and grows only roughly as fast as one moves away.
    """

    clip_m: float

    def distances(self, points: np.ndarray) -> np.ndarray:
        """Distances (P,) float32 in metres at points (P, 3) in metres."""
        ...

    def gradients(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances (P,) in metres at points (P, 3), and their gradients (P, 3)."""
        ...


class NetworkField:
    """Distances of points to the garment of a code, on a given body.

    What does not depend on the points is computed once. Fulfils `DistanceField`.

    Args:
        z: (cut + style,) the code.
        shape: (10,) of the wearer.
        gender: of the wearer, "female" or "male".

    Attributes:
        layers: weights and biases that points pass through, see `FieldDecoder.layers`.
        clip_m: the greatest distance that it tells.
    """

    def __init__(self, model: GarmentField, z: np.ndarray, shape: np.ndarray, gender: str) -> None:
        self._device, self.clip_m = model.device, model.d_max_m
        with torch.no_grad():
            places = model.places(
                torch.as_tensor(shape, dtype=torch.float32, device=self._device)[None],
                torch.tensor([GENDERS.index(gender)], device=self._device),
            )
            code = torch.as_tensor(z, dtype=torch.float32, device=self._device)[None]
            cut, style = code.split([model.decoder.cut, model.decoder.style], 1)
            self.layers = model.decoder.layers(model.decoder.condition(places, cut, style))

    def distances(self, points: np.ndarray) -> np.ndarray:
        """(P,) float32 metres of points (P, 3), learned up to d_max; may be negative."""
        with torch.no_grad():
            parts = [self._predict(part).cpu() for part in self._split(points)]
        return torch.cat(parts).numpy() if parts else np.zeros(0, np.float32)

    def gradients(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances (P,) in metres and their gradients (P, 3)."""
        found = []
        for part in self._split(points):
            part.requires_grad_(True)
            with torch.enable_grad():
                distance = self._predict(part)
                (slope,) = torch.autograd.grad(distance.sum(), part)
            found.append((distance.detach().cpu().numpy(), slope.cpu().numpy()))
        if not found:
            return np.zeros(0, np.float32), np.zeros((0, 3), np.float32)
        distances, slopes = zip(*found, strict=True)
        return np.concatenate(distances), np.concatenate(slopes)

    def _split(self, points: np.ndarray) -> tuple[torch.Tensor, ...]:
        tensor = torch.tensor(points, dtype=torch.float32, device=self._device)
        return tensor.split(_BATCH) if len(tensor) else ()

    def _predict(self, points: torch.Tensor) -> torch.Tensor:
        x = points
        for weight, bias in self.layers[:-1]:
            x = torch.addmm(bias, x, weight).relu_()
        weight, bias = self.layers[-1]
        return torch.addmm(bias, x, weight)[:, 0] * self.clip_m


class NearBody:
    """A field that is evaluated only where cloth can be; elsewhere it is `REACH_M`.

    Args:
        field: within the box.
        box: lowest and highest corner, metres.
        body: (V, 3) the wearer.
    """

    def __init__(self, field: DistanceField, box: Box, body: np.ndarray) -> None:
        self._field, self._low, self.clip_m = field, np.asarray(box[0]), field.clip_m
        counts = np.ceil((np.asarray(box[1]) - self._low) / _BLOCK_M).astype(int) + 1
        centres = np.moveaxis(np.indices(counts), 0, -1).reshape(-1, 3) + 0.5
        reach = REACH_M + _BLOCK_M * 3**0.5 / 2
        tree = KDTree(body, leafsize=_LEAF)
        away, _ = tree.query(self._low + _BLOCK_M * centres, distance_upper_bound=reach)
        self._near = np.isfinite(away).reshape(counts)

    def distances(self, points: np.ndarray) -> np.ndarray:
        """(P,) metres of points (P, 3) within the box."""
        block = ((points - self._low) / _BLOCK_M).astype(int)
        near = self._near[tuple(np.clip(block, 0, np.array(self._near.shape) - 1).T)]
        found = np.full(len(points), REACH_M, dtype=np.float32)
        found[near] = self._field.distances(points[near])
        return found

    def gradients(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of the field itself."""
        return self._field.gradients(points)
