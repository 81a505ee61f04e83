"""The garment VAEs of CLOTH3D, static and dynamic, with their losses and schedules."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F

from drapeline.models.gcvae.codec import GarmentCodec, TopologyBatch, conditions_of, kl_nat, planes
from drapeline.models.gcvae.data import BodyTemplate, rest_bodies
from drapeline.models.gcvae.networks import Code, ConditioningAutoencoder, Gcvae
from drapeline.models.gcvae.settings import DvaeSettings, VaeSettings
from drapeline.models.layers.graphs import FaceNormals
from drapeline.models.training.batches import Batch
from drapeline.models.training.module import RATE_SHARE, TrainableModule
from drapeline.registration.to_body.topology import TOPOLOGIES
from drapeline.seeding import rng_for

_SMALL_M = 1e-5


def offset_sums(
    predicted: torch.Tensor, true: torch.Tensor, mask: torch.Tensor | None
) -> torch.Tensor:
    """Sum of |predicted - true| over (V, 3, B), within a mask (V, B), and of how many numbers."""
    error = (predicted - true).abs().sum(1)
    if mask is None:
        return torch.stack([error.sum(), error.new_tensor(3.0 * error.numel())])
    return torch.stack([(error * mask).sum(), 3 * mask.sum().to(error.dtype)])


def distance_sums(
    predicted: torch.Tensor, true: torch.Tensor, mask: torch.Tensor | None
) -> torch.Tensor:
    """Sum of the distances in centimetres between (V, 3, B) metres in a mask (V, B), and count."""
    distance = ((predicted - true).square().sum(1) + _SMALL_M**2).sqrt() * 100
    if mask is None:
        return torch.stack([distance.sum(), distance.new_tensor(float(distance.numel()))])
    return torch.stack([(distance * mask).sum(), mask.sum().to(distance.dtype)])


def normal_sums(predicted: torch.Tensor, true: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
    """Sum of the L1 norm between normals (F, 3, B) over the faces of a mask (F, B), and number."""
    error = (predicted - true).abs().sum(1)
    return torch.stack([(error * faces).sum(), faces.sum().to(error.dtype)])


def mask_sums(logit: torch.Tensor, mask: torch.Tensor, form: str) -> torch.Tensor:
    """Sum over (V, B) of the mask's error in the form asked for, and the number of vertices."""
    true = mask.to(logit.dtype)
    if form == "bce":
        error = F.binary_cross_entropy_with_logits(logit, true, reduction="sum")
    else:
        error = (torch.sigmoid(logit) - true).abs().sum()
    return torch.stack([error, error.new_tensor(float(logit.numel()))])


_LINEAR_RATE_SHARE = 0.3


@dataclass(frozen=True)
class VaeBatch(TopologyBatch):
    """The samples of a topology as the networks see them."""

    base: torch.Tensor  # (V, 3, B_t) metres, what the offsets are added to
    inputs: torch.Tensor  # (V, C, B_t) normalised encoder input
    target: torch.Tensor  # (V, 3, B_t) normalised offsets


class GarmentVae(GarmentCodec[VaeBatch], TrainableModule):
    """Base class of SVAE and DVAE: network, loss, schedules and metrics.

    Args:
        settings: sizes, loss and training.
        body_template: graphs, faces, statistics and rest bodies.
        inputs: encoder channels per vertex beside offsets and mask.
    """

    def __init__(self, settings: VaeSettings, body_template: BodyTemplate, *, inputs: int) -> None:
        super().__init__(settings, body_template)
        seed = settings.training.seed
        rng = torch.Generator().manual_seed(int(rng_for(seed, "weights").integers(2**62)))
        self.build(body_template, inputs, rng)
        self.normals: Any = torch.nn.ModuleDict(
            {
                name: FaceNormals(
                    body_template.faces[name],
                    len(body_template.body_mean),
                    parts=settings.training.normal_parts,
                    rng=rng_for(seed, "faces", name),
                )
                for name in TOPOLOGIES
            }
        )
        for name in ("base", "body"):
            for moment in ("mean", "std"):
                self._constant(f"{name}_{moment}")
        self._constant("body_basis")

    @property
    def latent(self) -> int:
        """Numbers of a code."""
        return self.settings.network.latent

    @property
    def seed(self) -> int:
        """Seed of weights, order and noise."""
        return self.settings.training.seed

    def build(self, body_template: BodyTemplate, inputs: int, rng: torch.Generator) -> None:
        """Make the networks."""
        size = self.settings.network
        self.conditioning = ConditioningAutoencoder(
            len(body_template.cvar_mean),
            2 * size.condition,
            size.condition,
            mean=torch.from_numpy(body_template.cvar_mean),
            std=torch.from_numpy(body_template.cvar_std),
            rng=rng,
        ).requires_grad_(False)
        garment = 3 + size.masked_input
        self.network = Gcvae(
            body_template,
            size,
            inputs=garment + inputs,
            garment=garment,
            mask=self.settings.training.mask,
            rng=rng,
        )

    @abstractmethod
    def base_and_inputs(
        self, batch: Batch, rows: torch.Tensor
    ) -> tuple[torch.Tensor, list[torch.Tensor]]:
        """Base of the offsets, and further inputs of the encoder: (V, 3, B_t) each."""

    # ---- from batches to parts and back

    def normalise(self, x: torch.Tensor, name: str) -> torch.Tensor:
        """(V, 3, B) metres -> deviations, per vertex, from the mean of `name`: "base" or "body"."""
        mean, std = getattr(self, f"{name}_mean"), getattr(self, f"{name}_std")
        return (x - mean[..., None]) / std[..., None]

    def part(self, name: str, batch: Batch, rows: torch.Tensor) -> VaeBatch:
        """With what the networks see of it."""
        part = TopologyBatch.of(batch, rows)
        base, inputs = self.base_and_inputs(batch, rows)
        target = self.normalise_offsets(part.offsets, name)
        shown = [target]
        if self.settings.network.masked_input:
            inside = part.mask.to(target.dtype)[:, None]
            shown = [target * inside, inside]
        seen = torch.cat([*shown, *inputs], 1)
        return VaeBatch(**vars(part), base=base, inputs=seen, target=target)

    def encode_parts(self, parts: Mapping[str, VaeBatch]) -> Code:
        """Codes in the order of the parts."""
        return self.network.encode(network_inputs(parts))

    def decode_parts(
        self, z: torch.Tensor, cvar: torch.Tensor, counts: Mapping[str, int]
    ) -> dict[str, torch.Tensor]:
        """Topology -> (V, 3 or 4, B_t) normalised offsets and any mask logit."""
        out = self.network.decode(z, self.conditioning(cvar), counts)
        return {name: x.transpose(1, 2).contiguous() for name, x in out.items()}

    # ---- training

    def optimizer(self) -> torch.optim.Optimizer:
        """Adam, with smaller steps for the linear path.

        Its outputs are sums over all vertices, or of all numbers of a code, so steps as large as
        elsewhere would change them by more than they are.
        """
        straight = {
            id(weight): weight
            for part in (self.network.encoder, self.network.decoder)
            for weight in (part.linear_path.parameters() if part.linear_path else ())
        }
        others = [p for p in self.parameters() if p.requires_grad and id(p) not in straight]
        groups = [
            {"params": others, RATE_SHARE: 1.0},
            {"params": list(straight.values()), RATE_SHARE: _LINEAR_RATE_SHARE},
        ]
        rate = self.settings.training.learning_rate
        return torch.optim.Adam([group for group in groups if group["params"]], lr=rate, fused=True)

    def training_step(self, batch: Batch) -> torch.Tensor:
        """Loss of equation 3 for one batch."""
        parts = self.parts(batch)
        cvar, counts = conditions_of(parts)
        code = self.encode_parts(parts)
        z = code.mean + self._noise(code.mean) * (0.5 * code.log_variance).exp()
        out = self.decode_parts(z, cvar, counts)
        terms = self.garment_terms(parts, out, self.progress.step % len(self.normals["body"].edges))
        terms |= self.code_terms(code, cvar)
        scale = {
            "offsets": 1.0,
            "kl": self.settings.loss.kl_weight(self.progress.share),
        }
        loss = sum(
            (scale[key] if key in scale else getattr(self.settings.loss, key)) * term
            for key, term in terms.items()
        )
        self.stop_if_unfinite(loss, terms, batch["names"])
        self.log_means("train", {"loss": loss, **terms}, len(cvar))
        return loss

    def code_terms(self, code: Code, cvar: torch.Tensor) -> dict[str, torch.Tensor]:
        """Regression of the conditions' code and KL divergence, of equation 3."""
        return {
            "condition": (code.condition - self.conditioning(cvar)).abs().mean(),
            "kl": kl_nat(code.mean, code.log_variance).mean() / code.mean.shape[1],
        }

    def garment_terms(
        self, parts: Mapping[str, VaeBatch], out: Mapping[str, torch.Tensor], faces: int
    ) -> dict[str, torch.Tensor]:
        """Offsets, normals and mask terms of equation 4, over all topologies together."""
        weights = self.settings.loss
        sums = {key: out[next(iter(out))].new_zeros(2) for key in ("offsets", "normals", "mask")}
        for name, part in parts.items():
            x = out[name]
            inside = part.mask if weights.offsets_within == "mask" else None
            if weights.offsets_form == "l1":
                sums["offsets"] = sums["offsets"] + offset_sums(x[:, :3], part.target, inside)
            else:
                made = self.to_metres(x[:, :3], name)
                sums["offsets"] = sums["offsets"] + distance_sums(made, part.offsets, inside)
            if weights.normals:
                normals = self.normals[name]
                true = normals(part.base + part.offsets, faces)
                made = normals(part.base + self.to_metres(x[:, :3], name), faces)
                among = normals.mask(part.mask, faces)
                sums["normals"] = sums["normals"] + normal_sums(made, true, among)
            if x.shape[1] > 3:
                sums["mask"] = sums["mask"] + mask_sums(x[:, 3], part.mask, weights.mask_form)
        return {key: total / count.clamp_min(1) for key, (total, count) in sums.items()}

    def validation_step(self, batch: Batch) -> None:
        """Log `selection`, by which the best weights are chosen, and metrics, at the mean code.

        It is L_o and a share of the KL divergence, whose mean over z the paper weighs by 0.1.
        """
        parts = self.parts(batch)
        cvar, counts = conditions_of(parts)
        code = self.encode_parts(parts)
        out = self.decode_parts(code.mean, cvar, counts)
        nats = kl_nat(code.mean, code.log_variance).mean()
        offsets = self.garment_terms(parts, out, 0)["offsets"]
        values = {
            "selection": offsets + self.settings.loss.kl_selection * nats / code.mean.shape[1],
            "offsets": offsets,
            "kl_nat": nats,
            **self._metrics(parts, out),
        }
        self.log_means("val", values, len(cvar))

    def _metrics(
        self, parts: Mapping[str, VaeBatch], out: Mapping[str, torch.Tensor]
    ) -> dict[str, torch.Tensor]:
        """Means over samples of surface error in mm and, with a mask branch, of mask IoU."""
        errors, overlaps = [], []
        for name, part in parts.items():
            distance = (self.to_metres(out[name][:, :3], name) - part.offsets).norm(dim=1)
            errors.append((distance * part.mask).sum(0) / part.mask.sum(0).clamp_min(1))
            if out[name].shape[1] > 3:
                made = out[name][:, 3] > 0
                overlaps.append((made & part.mask).sum(0) / (made | part.mask).sum(0).clamp_min(1))
        values = {"surface_error_mm": 1000 * torch.cat(errors).mean()}
        if overlaps:
            values["mask_iou"] = torch.cat(overlaps).mean()
        return values

    def _noise(self, like: torch.Tensor) -> torch.Tensor:
        """Standard normal numbers that depend on seed, step and rank alone.

        A training that is resumed thus draws the same ones.
        """
        rng = rng_for(self.settings.training.seed, "noise", self.progress.step, self.progress.rank)
        return torch.from_numpy(rng.standard_normal(like.shape, dtype=np.float32)).to(like)


def network_inputs(parts: Mapping[str, VaeBatch]) -> dict[str, torch.Tensor]:
    """Topology -> (V, B_t, C), as the graph network takes it."""
    return {name: part.inputs.transpose(1, 2).contiguous() for name, part in parts.items()}


class StaticVae(GarmentVae):
    """SVAE: garments in rest pose, conditioned on shape, gender and tightness."""

    checkpoint_type = "static"
    model = "svae"
    SETTINGS = VaeSettings

    def __init__(self, settings: VaeSettings, body_template: BodyTemplate) -> None:
        super().__init__(settings, body_template, inputs=3)

    def base_and_inputs(
        self, batch: Batch, rows: torch.Tensor
    ) -> tuple[torch.Tensor, list[torch.Tensor]]:
        """Offsets are added to the rest body T, which the encoder sees too."""
        body = rest_bodies(self.body_basis, batch["cvar"][rows])
        return body, [self.normalise(body, "base")]


class DynamicVae(GarmentVae):
    """DVAE: garments in motion, conditioned on poses and on the garment's static code as well.

    The mask is that of the static garment, so there is no mask branch. Version "posed": offsets
    C_d - T_d are added to the posed body, which the encoder sees too. Version "unposed": offsets
    K^-1(C_d) - C_s are added to the static garment, and the encoder sees it and the rest body.
    A batch brings what its offsets are added to as `base` (B, V, 3).
    """

    checkpoint_type = "dynamic"
    model = "dvae"
    SETTINGS = DvaeSettings

    def __init__(self, settings: DvaeSettings, body_template: BodyTemplate) -> None:
        super().__init__(
            settings, body_template, inputs=6 if settings.training.version == "unposed" else 3
        )

    def base_and_inputs(
        self, batch: Batch, rows: torch.Tensor
    ) -> tuple[torch.Tensor, list[torch.Tensor]]:
        """The posed body; or the static garment, and the rest body as a further input."""
        base = planes(batch["base"][rows])
        inputs = [self.normalise(base, "base")]
        if self.settings.training.version == "unposed":
            body = rest_bodies(self.body_basis, batch["cvar"][rows])
            inputs.append(self.normalise(body, "body"))
        return base, inputs
