"""The distance field of one garment as its trained network predicts it."""

import numpy as np
import torch

from drapeline.models.smplicit.network import GarmentField

# Points at once: activations of so many stay in the processor's cache.
_BATCH = 1024


class NetworkField:
    """Distances of points to the garment of a code, on a given body.

    What does not depend on the points is computed once. Fulfils `fields.Field`.

    Args:
        model: trained.
        z: (cut + style,) the code.
        shape: (10,) of the wearer.
        gender: of the wearer, 0 female, 1 male.

    Attributes:
        layers: weights and biases that points pass through, see `Decoder.layers`.
        clip_m: the greatest distance that it tells.
    """

    def __init__(self, model: GarmentField, z: np.ndarray, shape: np.ndarray, gender: int) -> None:
        self._device, self.clip_m = model.device, model.d_max_m
        with torch.no_grad():
            places = model.places(
                torch.as_tensor(shape, dtype=torch.float32, device=self._device)[None],
                torch.tensor([gender], device=self._device),
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
