"""Garment VAEs in closed form: probabilistic PCA, with a graph network that refines it."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
import torch

from drapeline.models.gcvae.body_template import BodyTemplate, rest_bodies
from drapeline.models.gcvae.networks import PLACES, Code, mesh_graphs
from drapeline.models.gcvae.ppca import Ppca, blur_mask, fit_ppca
from drapeline.models.gcvae.refiner import Refiner
from drapeline.models.gcvae.vae import (
    DynamicVae,
    Garments,
    GarmentVae,
    Part,
    StaticVae,
    conditions_of,
)
from drapeline.models.training.batches import Batch, as_tensors, refuse_unfinite
from drapeline.registration.to_body.super_body import mirror_of
from drapeline.seeding import rng_for


class MirroredGarments(Garments, Protocol):
    """Garments whose mirror images are garments as well."""

    def mirrored_cvar(self, rows: np.ndarray) -> np.ndarray:
        """(n, C) conditions of the rows' mirror images."""


@dataclass(frozen=True)
class PpcaConstants:
    """Constants of the probabilistic PCA and of its refiner.

    Attributes:
        unit_m: unit of the offsets in a field.
        blur_passes: that turn the mask into a ramp, whose width grows with their square root.
        ramp_weight: of the mask's channel against offsets in `unit_m`.
        rounds: of filling in what is missing.
        ridge: penalty of the regression on the conditions, counted in samples.
        noise: least variance that the posterior assumes of every number, in `unit_m` squared. It
            is more than the fit leaves of the training rows: neighbouring vertices err alike, so
            they are less evidence than their number, and new garments vary in ways that no
            component has.
        rows_max: the fit uses at most so many training rows.
        vertices_max: the posterior looks at no more vertices, chosen at random.
        widths: of the refiner, finest first.
        steepness: of the mask's logit against its ramp.
    """

    unit_m: float = 0.02
    blur_passes: int = 10
    ramp_weight: float = 0.7
    rounds: int = 10
    ridge: float = 20.0
    noise: float = 0.1
    rows_max: int = 2000
    vertices_max: int = 3000
    widths: tuple[int, ...] = (16, 32, 64)
    steepness: float = 6.0


class PpcaVae(GarmentVae):
    """Probabilistic PCA of partly missing fields as a conditional VAE, refined by a graph U-Net.

    Posterior and decoder of the PCA are exact and computed before training. Training fits the
    refiner, from the field of a sampled code and the rest body to offsets and mask, so decoding
    needs only z and the conditions, as in the paper's network.

    Attributes:
        constants: of the fit.
        channels: of a field: offsets, and the ramp of the mask where there is one.
    """

    constants: ClassVar[PpcaConstants]
    channels: ClassVar[int]

    def build(self, body_template: BodyTemplate, inputs: int, rng: torch.Generator) -> None:
        """Make the graphs, the PCA and the refiner."""
        network, vertices = self.settings.network, len(body_template.offset_mean)
        count = min(self.constants.vertices_max, vertices)
        rng_observed = rng_for(self.settings.training.seed, "posterior")
        observed = np.sort(rng_observed.permutation(vertices)[:count])
        self.graphs = mesh_graphs(body_template, network.order)
        self.ppca = Ppca(
            vertices,
            len(body_template.cvar_mean),
            network.latent,
            torch.from_numpy(observed),
            self.channels,
        )
        for moment in ("mean", "std"):
            self._constant(f"cvar_{moment}")
        self.refiner = Refiner(
            self.channels + 3, self.channels, PLACES, self.constants.widths, network.order, rng
        )
        self._codes: dict[str, tuple[torch.Tensor, torch.Tensor]] = {}

    @torch.no_grad()
    def prepare(self, garments: MirroredGarments) -> None:
        """Fit the PCA to the training rows.

        Raises:
            InputError: offsets are not finite; names the samples.
        """
        rows = garments.rows("train")
        if len(rows) > self.constants.rows_max:
            rng = rng_for(self.settings.training.seed, "linear rows")
            rows = np.sort(rng.choice(rows, self.constants.rows_max, replace=False))
        batch = garments.batch(rows)
        refuse_unfinite(batch["offsets"], batch["names"], "offsets")
        fields, known, conditions = self._known_fields(batch)
        mirror = mirror_of(
            self.body_template.body_mean.astype(np.float64), self.body_template.faces["body"]
        )
        if mirror is not None:  # a garment's mirror image is a garment too
            image = {**mirror_batch(batch, mirror), "cvar": garments.mirrored_cvar(rows)}
            seen = self._known_fields(image)
            fields, known, conditions = (
                torch.cat(pair) for pair in zip((fields, known, conditions), seen, strict=True)
            )
        fit = fit_ppca(
            fields,
            known,
            conditions,
            latent=self.settings.network.latent,
            rounds=self.constants.rounds,
            ridge=self.constants.ridge,
        )
        self.ppca.set_fit(fit._replace(noise=fit.noise.clamp_min(self.constants.noise)))

    def _known_fields(self, batch: Batch) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Fields (n, V * channels), where they are known, and normalised conditions (n, C)."""
        parts = self.parts(as_tensors(batch))
        fields = torch.cat([self.fields(name, part) for name, part in parts.items()], 2)
        mask = torch.cat([part.mask for part in parts.values()], 1)
        known = mask[:, None].repeat(1, self.channels, 1)
        known[:, 3:] = True
        flat = (x.flatten(0, 1).T.contiguous() for x in (fields, known))
        return *flat, self._normalise_conditions(conditions_of(parts)[0])

    def encode_parts(self, parts: Mapping[str, Part]) -> Code:
        """The exact posterior of the PCA; it never changes, so training remembers it."""
        means, log_variances = [], []
        for name, part in parts.items():
            if self.position is not None and all(n in self._codes for n in part.names):
                pairs = [self._codes[n] for n in part.names]
                mean, log_variance = (torch.stack(half) for half in zip(*pairs, strict=True))
            else:
                mean, log_variance = self.ppca.posterior(
                    self.fields(name, part), part.mask, self._normalise_conditions(part.cvar)
                )
                if self.position is not None:
                    self._codes |= zip(
                        part.names, zip(mean, log_variance, strict=True), strict=True
                    )
            means.append(mean)
            log_variances.append(log_variance)
        mean = torch.cat(means)
        return Code(mean, torch.cat(log_variances), mean[:, :0])

    def decode_parts(
        self, z: torch.Tensor, cvar: torch.Tensor, counts: Mapping[str, int]
    ) -> dict[str, torch.Tensor]:
        """Topology -> (V, channels, B_t) normalised offsets and any mask logit."""
        field = self.ppca(z, self._normalise_conditions(cvar))
        body = rest_bodies(self.body_basis, cvar)
        seen = torch.cat([field, self.normalised_body(body)], 1)
        out, start = {}, 0
        for name, count in counts.items():
            part = slice(start, start + count)
            graph = self.graphs[name]
            change = self.refiner(graph, seen[..., part].transpose(1, 2).contiguous())
            change = change.transpose(1, 2)
            offsets = self.normalise(self._to_metres(field[:, :3, part]), "offset")
            ramp = field[:, 3:, part] * (self.constants.steepness / self.constants.ramp_weight)
            out[name] = torch.cat([offsets, ramp], 1) + change
            start += count
        return out

    @abstractmethod
    def normalised_body(self, body: torch.Tensor) -> torch.Tensor:
        """Rest bodies (V, 3, B) in metres, normalised for the refiner."""

    @abstractmethod
    def fields(self, name: str, part: Part) -> torch.Tensor:
        """(V, channels, B_t) of garments of topology `name`."""

    def offsets_in_units(self, part: Part) -> torch.Tensor:
        """(V, 3, B_t) offsets from their mean, in `unit_m`."""
        return (part.offsets - self.offset_mean[..., None]) / self.constants.unit_m

    def code_terms(self, code: Code, cvar: torch.Tensor) -> dict[str, torch.Tensor]:
        """None, since the encoder is not trained."""
        return {}

    def _normalise_conditions(self, cvar: torch.Tensor) -> torch.Tensor:
        return (cvar - self.cvar_mean) / self.cvar_std

    def _to_metres(self, units: torch.Tensor) -> torch.Tensor:
        return units * self.constants.unit_m + self.offset_mean[..., None]


class StaticPpcaVae(PpcaVae, StaticVae):
    """Garments at rest. The mask is a fourth channel: a ramp across the hem."""

    checkpoint_type = "linear"
    constants = PpcaConstants()
    channels = 4

    def normalised_body(self, body: torch.Tensor) -> torch.Tensor:
        """By the statistics of `base`, which is the rest body."""
        return self.normalise(body, "base")

    def fields(self, name: str, part: Part) -> torch.Tensor:
        """(V, 4, B_t): offsets from their mean in `unit_m`, and the ramp of the mask."""
        ramp = blur_mask(part.mask, self.graphs[name].laplacians[0], self.constants.blur_passes)
        return torch.cat(
            [self.offsets_in_units(part), self.constants.ramp_weight * ramp[:, None]], 1
        )


class DynamicPpcaVae(PpcaVae, DynamicVae):
    """Garments in motion. The mask is that of the static garment, so a field is offsets alone.

    A few sequences say little about what poses and static codes do to cloth, so the regression on
    them is penalised more. Their frames are alike, so the posterior assumes more noise; otherwise
    codes of new frames would lie far outside the prior.
    """

    checkpoint_type = "linear_dynamic"
    resolves_penetration = True
    constants = PpcaConstants(ridge=2000.0, noise=3.0)
    channels = 3

    def normalised_body(self, body: torch.Tensor) -> torch.Tensor:
        """By the statistics of the samples' rest bodies."""
        return self.normalise(body, "body")

    def fields(self, name: str, part: Part) -> torch.Tensor:
        """(V, 3, B_t): offsets from their mean in `unit_m`."""
        return self.offsets_in_units(part)


def mirror_batch(batch: Batch, mirror: np.ndarray) -> Batch:
    """Exchange left and right in the offsets and masks of a batch.

    Args:
        mirror: (V,) vertex on the other side.
    """
    flip = np.array([-1, 1, 1], dtype=np.float32)
    return {
        **batch,
        "offsets": batch["offsets"][:, mirror] * flip,
        "mask": batch["mask"][:, mirror],
    }
