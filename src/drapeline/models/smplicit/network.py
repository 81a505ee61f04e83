"""SMPLicit's decoder, image encoder and styles as they are trained together (3.3).

B garments, P points, K clusters of the body, Z numbers of a code, H0 outputs of the decoder's first
joint layer. The network's distances are in units of d_max.
"""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import SHAPES, rest_basis
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.learning_data.garment_fields import FieldData
from drapeline.models.layers.linear import full_precision
from drapeline.models.smplicit.decoder import FieldDecoder
from drapeline.models.smplicit.encoder import ImageEncoder, load_encoder_weights
from drapeline.models.smplicit.garments import FIELD_MODELS
from drapeline.models.smplicit.settings import FieldSettings
from drapeline.models.training.batches import Batch
from drapeline.models.training.checkpoints import load_network
from drapeline.models.training.module import BEST, RATE_SHARE, TrainableModule
from drapeline.models.training.optimise import JointOptimizer, Linearised, Muon, fit_least_squares
from drapeline.seeding import rng_for

BASIS_ROWS = len(GENDERS) * (1 + SHAPES)
# Below them, absolute values are taken for squares: distances in units of d_max, and codes.
_LEAST_RESIDUAL, _LEAST_NUMBER = 0.1, 0.02
_VALIDATION_STEPS = 16


def cluster_basis(bodies: Mapping[str, BodyModel], clusters: np.ndarray) -> torch.Tensor:
    """(`BASIS_ROWS`, K, 3) float32 rows of `rest_basis` for some vertices (K,) of the bodies."""
    return torch.from_numpy(rest_basis(bodies)[:, clusters].astype(np.float32))


def cluster_places(basis: torch.Tensor, shape: torch.Tensor, gender: torch.Tensor) -> torch.Tensor:
    """(B, K, 3) clusters of bodies at rest, metres.

    Args:
        basis: of `cluster_basis`.
        shape: (B, 10).
        gender: (B,) 0 female, 1 male.
    """
    male = gender.to(shape)[:, None]
    one = torch.cat([torch.ones_like(male), shape], 1)
    factors = torch.cat([one * (1 - male), one * male], 1)
    return (factors @ basis.flatten(1)).unflatten(1, (-1, 3))


class Points(NamedTuple):
    """Points (B, P, 3) with their clipped distances (B, P), in units of d_max."""

    places: torch.Tensor
    distance: torch.Tensor


@full_precision
def fit_codes(
    decoder: FieldDecoder,
    points: Points,
    places: torch.Tensor,
    z: torch.Tensor,
    latent: float,
    steps: int,
) -> torch.Tensor:
    """(B, cut + style) codes with the least mean error of distances plus `latent` times their size.

    Absolute values are minimised as weighted squares. A code reaches the decoder through the first
    joint layer alone, as one summand for all points, so the derivatives by 18 numbers take a single
    backward pass, and what the points contribute is computed once. The decoder is left as it is. No
    code is worse than the one that it started from.

    Args:
        points: of B garments.
        places: (B, K, 3) clusters of the wearers.
        z: (B, cut + style) to start from.
        latent: lambda_z, the weight of the codes' mean absolute value.
        steps: each takes one pass through the decoder and back.
    """
    with torch.no_grad():
        query = decoder.query(points.places, *decoder.fold(places))
        squares = partial(_linearise, decoder, query, points.distance, latent)
        return fit_least_squares(z.detach(), squares, steps)


def _linearise(
    decoder: FieldDecoder,
    query: torch.Tensor,
    distance: torch.Tensor,
    latent: float,
    z: torch.Tensor,
) -> Linearised:
    z_cut, z_style = z.split([decoder.cut, decoder.style], 1)
    hidden = query + decoder.base(z_cut, z_style)[:, None]
    with torch.enable_grad():
        hidden.requires_grad_(True)
        predicted = decoder.joint(hidden)
        (by_hidden,) = torch.autograd.grad(predicted.sum(), hidden)
    residual = predicted.detach() - distance
    return Linearised(
        residual,
        by_hidden @ decoder.base_slopes(z_style),  # (B, P, H0) by (B, H0, Z)
        1 / residual.abs().clamp(min=_LEAST_RESIDUAL) / residual.shape[1],
        latent / z.shape[1] / z.abs().clamp(min=_LEAST_NUMBER),
        residual.abs().mean(1) + latent * z.abs().mean(1),
    )


class GarmentField(TrainableModule):
    """A model of SMPLicit for the garments of some types.

    Args:
        name: of `FIELD_MODELS`.
        place_basis: (22, K, 3) float32 of the clusters, rows of
            `drapeline.bodies.rest_body.rest_basis`.
        rows: of the data, each of which has a style.
        start: whether the image encoder begins with the file that the settings name.

    Raises:
        InputError: that file is no ResNet-18 of this size.
    """

    checkpoint_type = "smplicit"

    def __init__(
        self,
        name: str,
        settings: FieldSettings,
        place_basis: torch.Tensor,
        rows: int,
        *,
        start: bool = True,
    ) -> None:
        super().__init__()
        self.name = name
        self.settings: FieldSettings = settings
        sizes, seed = settings.network, settings.training.seed
        rng = torch.Generator().manual_seed(int(rng_for(seed, "weights").integers(2**62)))
        self.decoder = FieldDecoder(
            place_basis.shape[1], sizes.cut, sizes.style, width=sizes.width, rng=rng
        )
        self.encoder = ImageEncoder(sizes.cut, sizes.encoder_width, rng)
        if sizes.encoder_weights and start:
            load_encoder_weights(self.encoder, sizes.encoder_weights)
        self.styles = torch.nn.Parameter(torch.zeros(rows, sizes.style))
        self.place_basis: torch.Tensor
        self.register_buffer("place_basis", place_basis)

    @property
    def d_max_m(self) -> float:
        """Distance at which others are clipped, metres."""
        return self.settings.loss.d_max_m

    def checkpoint_metadata(self) -> dict[str, Any]:
        """Settings and sizes for the checkpoint."""
        return {
            "checkpoint_type": self.checkpoint_type,
            "name": self.name,
            "settings": self.settings.plain(),
            "clusters": self.decoder.clusters,
            "rows": len(self.styles),
        }

    def places(self, shape: torch.Tensor, gender: torch.Tensor) -> torch.Tensor:
        """(B, K, 3) clusters of bodies at rest, metres; see `cluster_places`."""
        return cluster_places(self.place_basis, shape, gender)

    def training_step(self, batch: Batch) -> torch.Tensor:
        """L_d + lambda_z L_z at some of the garments' points (equation 4 and below)."""
        points = self._draw(batch)
        z_cut = self.encoder(batch["occlusion"])
        z = torch.cat([z_cut, self.styles[batch["row"]]], 1)
        places = self.places(batch["shape"], batch["gender"])
        noise = self.settings.loss.noise * self._normal(z)
        distance = self._loss(points, places, z + noise)
        latent = z.abs().mean()
        loss = distance + self.settings.loss.latent * latent
        terms = {"distance_mm": 1000 * self.d_max_m * distance, "latent": latent}
        self.stop_if_unfinite(loss, terms, batch["names"])
        self.log_means("train", terms, len(z))
        return loss

    def validation_step(self, batch: Batch) -> None:
        """Distances at points that a style was not fitted to, for the encoder's z_cut."""
        training = self.settings.training
        near, space = (
            min(wanted, batch[f"{name}_distance"].shape[1] // 2)
            for name, wanted in (("near", training.near), ("space", training.space))
        )
        known, asked = (
            self._points(
                batch,
                slice(part * near, (part + 1) * near),
                slice(part * space, (part + 1) * space),
            )
            for part in range(2)
        )
        places = self.places(batch["shape"], batch["gender"])
        z_cut = self.encoder(batch["occlusion"])
        z_style = torch.zeros(len(z_cut), self.decoder.style, device=z_cut.device)
        start, latent = torch.cat([z_cut, z_style], 1), self.settings.loss.latent
        z = fit_codes(self.decoder, known, places, start, latent, _VALIDATION_STEPS)
        with torch.no_grad():
            distance = 1000 * self.d_max_m * self._loss(asked, places, z)
        self.log_means("val", {"distance_mm": distance}, len(z))

    def predict(self, points: torch.Tensor, places: torch.Tensor, z: torch.Tensor) -> torch.Tensor:
        """(B, P) distances of points in units of d_max.

        Args:
            points: (B or 1, P, 3) metres; those of one garment are for all codes.
            places: (B or 1, K, 3) clusters of the wearers.
            z: (B, cut + style) codes.
        """
        z_cut, z_style = z.split([self.decoder.cut, self.decoder.style], 1)
        return self.decoder(points, places, z_cut, z_style)

    def _loss(self, points: Points, places: torch.Tensor, z: torch.Tensor) -> torch.Tensor:
        return (self.predict(points.places, places, z) - points.distance).abs().mean()

    def _normal(self, like: torch.Tensor) -> torch.Tensor:
        rng = rng_for(self.settings.training.seed, "noise", self.progress.step, self.progress.rank)
        return torch.from_numpy(rng.normal(size=like.shape)).to(like)

    def _draw(self, batch: Batch) -> Points:
        """As many points of each kind as a step takes, drawn for each step anew."""
        training = self.settings.training
        rng = rng_for(training.seed, "points", self.progress.step, self.progress.rank)
        count, near = batch["near_distance"].shape
        space = batch["space_distance"].shape[1]
        chosen = [
            np.sort(rng.integers(size, size=(count, wanted)), axis=1)
            for size, wanted in ((near, training.near), (space, training.space))
        ]
        return self._points(batch, *chosen)

    def _points(self, batch: Batch, near: Any, space: Any) -> Points:
        places, distances = [], []
        for name, some in (("near", near), ("space", space)):
            index: tuple[Any, Any] = (slice(None), some)
            if not isinstance(some, slice):
                index = (torch.arange(len(some))[:, None], torch.from_numpy(some))
            places.append(batch[name][index])
            distances.append(batch[f"{name}_distance"][index])
        distance = torch.cat(distances, 1).clamp(max=self.d_max_m) / self.d_max_m
        return Points(torch.cat(places, 1), distance)

    def optimizer(self) -> torch.optim.Optimizer:
        """Muon with Adam, or the paper's Adam; see `FieldTraining`."""
        training = self.settings.training
        matrices, query, others = [], [], []
        for name, parameter in self.named_parameters():
            if name == "styles":
                continue
            if name.startswith("decoder.fc0_query"):
                query.append(parameter)
            elif name.endswith("weight_v") and training.optimizer == "muon":
                matrices.append(parameter)
            else:
                others.append(parameter)
        adam = [
            {"params": others, RATE_SHARE: 1.0},
            {"params": query, RATE_SHARE: training.query_rate},
            {"params": [self.styles], RATE_SHARE: training.style_rate},
        ]
        rate = training.learning_rate
        parts: list[torch.optim.Optimizer] = [torch.optim.Adam(adam, lr=rate, fused=True)]
        if matrices:
            group = [{"params": matrices, RATE_SHARE: training.muon_rate}]
            parts.append(Muon(group, lr=rate))
        return JointOptimizer(parts)


def load_field(folder: str | Path) -> GarmentField:
    """A trained model, ready to predict.

    Raises:
        InputError: the checkpoint is missing, damaged, or of another model.
    """

    def build(metadata: Mapping[str, Any]) -> GarmentField:
        name = metadata["name"]
        if name not in list(FIELD_MODELS):
            raise InputError(
                f"the model is named {name!r:.100}, expected {' or '.join(FIELD_MODELS)}"
            )
        settings = FieldSettings(**metadata["settings"])
        basis = torch.zeros(BASIS_ROWS, metadata["clusters"], 3)
        return GarmentField(name, settings, basis, metadata["rows"], start=False)

    return load_network(Path(folder) / BEST, GarmentField.checkpoint_type, build)


def new_field(
    name: str, data: FieldData, bodies: Mapping[str, BodyModel], settings: FieldSettings
) -> GarmentField:
    """An untrained model named as in `FIELD_MODELS`."""
    return GarmentField(name, settings, cluster_basis(bodies, data.clusters), len(data))
