"""Our own garment VAEs: closed-form linear ones, and a graph network that refines each."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch

from drapeline.models.gcvae.body_template import BodyTemplate, rest_bodies
from drapeline.models.gcvae.networks import PLACES, Code, graphs_of
from drapeline.models.gcvae.ppca import LinearPath, blurred, fit_linear
from drapeline.models.gcvae.refiner import Refiner
from drapeline.models.gcvae.vae import DynamicVae, GarmentVae, Part, StaticVae, conditions_of
from drapeline.models.training.batches import Batch, Garments, as_tensors, refuse_unfinite
from drapeline.registration.to_body.super_body import mirror_of
from drapeline.seeding import rng_for


@dataclass(frozen=True)
class LinearSize:
    """Constants of the linear path and of its refiner.

    Attributes:
        unit_m: offsets are counted in it.
        blur: passes that turn the mask into a ramp; its width grows with their root.
        field: weight of the mask's channel against offsets in `unit_m`.
        rounds: of filling in what is missing.
        ridge: penalty of the regression on the conditions, in samples.
        noise: variance that the posterior takes every number to have, in `unit_m` squared. More
            than what the fit leaves of the training rows: neighbours err alike, so they are less
            evidence than their number, and new garments hold what no component does.
        rows: the fit uses at most so many training rows.
        vertices: the posterior looks at so many vertices, evenly drawn.
        widths: of the refiner, finest first.
        steepness: of the mask's logit against its ramp.
    """

    unit_m: float = 0.02
    blur: int = 10
    field: float = 0.7
    rounds: int = 10
    ridge: float = 20.0
    noise: float = 0.1
    rows: int = 2000
    vertices: int = 3000
    widths: tuple[int, ...] = (16, 32, 64)
    steepness: float = 6.0


class LinearGarmentVae(GarmentVae):
    """Probabilistic PCA of partly missing fields as a conditional VAE, refined by a graph U-Net.

    Posterior and decoder of the linear path are exact and found before training. Training fits
    the refiner, from the field of a drawn code and the rest body to offsets and mask, so decoding
    needs z and the conditions only, as in the paper's network.

    Attributes:
        size: its constants.
        channels: of a field: offsets, and the ramp of the mask where there is one.
    """

    size: LinearSize
    channels: int

    def build(self, body_template: BodyTemplate, inputs: int, rng: torch.Generator) -> None:
        """Graphs, linear path and refiner."""
        network, vertices = self.settings.network, len(body_template.offset_mean)
        count = min(self.size.vertices, vertices)
        drawn = rng_for(self.settings.training.seed, "posterior").permutation(vertices)[:count]
        self.graphs = graphs_of(body_template, network.order)
        self.linear = LinearPath(
            vertices,
            len(body_template.cvar_mean),
            network.latent,
            torch.from_numpy(np.sort(drawn)),
            self.channels,
        )
        for moment in ("mean", "std"):
            self._constant(f"cvar_{moment}")
        self.refiner = Refiner(
            self.channels + 3, self.channels, PLACES, self.size.widths, network.order, rng
        )
        self._codes: dict[str, tuple[torch.Tensor, torch.Tensor]] = {}

    @torch.no_grad()
    def prepare(self, garments: Garments) -> None:
        """Fit the linear path to the training rows."""
        rows = garments.rows("train")
        if len(rows) > self.size.rows:
            rng = rng_for(self.settings.training.seed, "linear rows")
            rows = np.sort(rng.choice(rows, self.size.rows, replace=False))
        batch = garments.batch(rows)
        refuse_unfinite(batch["offsets"], batch["names"], "offsets")
        fields, known, conditions = self._known(batch)
        mirror = mirror_of(
            self.body_template.body_mean.astype(np.float64), self.body_template.faces["body"]
        )
        if mirror is not None:  # a garment's mirror image is a garment too
            image = {**mirrored(batch, mirror), "cvar": garments.mirrored_cvar(rows)}
            seen = self._known(image)
            fields, known, conditions = (
                torch.cat(pair) for pair in zip((fields, known, conditions), seen, strict=True)
            )
        fit = fit_linear(
            fields,
            known,
            conditions,
            latent=self.settings.network.latent,
            rounds=self.size.rounds,
            ridge=self.size.ridge,
        )
        self.linear.take(fit._replace(noise=fit.noise.clamp_min(self.size.noise)))

    def _known(self, batch: Batch) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Fields (n, V * channels), where they are known, and normalised conditions (n, C)."""
        parts = self.parts(as_tensors(batch))
        fields = torch.cat([self.fields(name, part) for name, part in parts.items()], 2)
        mask = torch.cat([part.mask for part in parts.values()], 1)
        known = mask[:, None].repeat(1, self.channels, 1)
        known[:, 3:] = True
        flat = (x.flatten(0, 1).T.contiguous() for x in (fields, known))
        return *flat, self._conditions(conditions_of(parts)[0])

    def encode_parts(self, parts: Mapping[str, Part]) -> Code:
        """The exact posterior of the linear path; it does not change, so training looks it up."""
        means, log_variances = [], []
        for name, part in parts.items():
            if self.position is not None and all(n in self._codes for n in part.names):
                pairs = [self._codes[n] for n in part.names]
                mean, log_variance = (torch.stack(half) for half in zip(*pairs, strict=True))
            else:
                mean, log_variance = self.linear.posterior(
                    self.fields(name, part), part.mask, self._conditions(part.cvar)
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
        field = self.linear(z, self._conditions(cvar))
        body = rest_bodies(self.body_basis, cvar)
        seen = torch.cat([field, self.seen_body(body)], 1)
        out, start = {}, 0
        for name, count in counts.items():
            part = slice(start, start + count)
            graph = self.graphs[name]
            change = self.refiner(graph, seen[..., part].transpose(1, 2).contiguous())
            change = change.transpose(1, 2)
            offsets = self.normalised(self._metres(field[:, :3, part]), "offset")
            ramp = field[:, 3:, part] * (self.size.steepness / self.size.field)
            out[name] = torch.cat([offsets, ramp], 1) + change
            start += count
        return out

    @abstractmethod
    def seen_body(self, body: torch.Tensor) -> torch.Tensor:
        """Rest bodies (V, 3, B) in metres, normalised for the refiner."""

    @abstractmethod
    def fields(self, name: str, part: Part) -> torch.Tensor:
        """(V, channels, B_t) of garments of topology `name`."""

    def units(self, part: Part) -> torch.Tensor:
        """(V, 3, B_t) offsets from their mean in `unit_m`."""
        return (part.offsets - self.offset_mean[..., None]) / self.size.unit_m

    def code_terms(self, code: Code, cvar: torch.Tensor) -> dict[str, torch.Tensor]:
        """None: nothing of the encoder is trained."""
        return {}

    def _conditions(self, cvar: torch.Tensor) -> torch.Tensor:
        return (cvar - self.cvar_mean) / self.cvar_std

    def _metres(self, units: torch.Tensor) -> torch.Tensor:
        return units * self.size.unit_m + self.offset_mean[..., None]


class LinearVae(LinearGarmentVae, StaticVae):
    """Garments at rest. Where the mask ends is a fourth channel: a ramp across the hem."""

    kind = "linear"
    size = LinearSize()
    channels = 4

    def seen_body(self, body: torch.Tensor) -> torch.Tensor:
        """By the statistics of what offsets are added to, which is the rest body."""
        return self.normalised(body, "base")

    def fields(self, name: str, part: Part) -> torch.Tensor:
        """(V, 4, B_t): offsets from their mean in `unit_m`, and the ramp of the mask."""
        ramp = blurred(part.mask, self.graphs[name].laplacians[0], self.size.blur)
        return torch.cat([self.units(part), self.size.field * ramp[:, None]], 1)


class LinearDynamicVae(LinearGarmentVae, DynamicVae):
    """Garments in motion. The mask is that of the static garment, so a field is offsets alone.

    A few sequences say little about what poses and static codes do to cloth, so the regression on
    them is held back more; and their frames are alike, so the posterior takes more for noise, or
    codes of new frames would lie far outside of the prior.
    """

    kind = "linear_dynamic"
    settles = True
    size = LinearSize(ridge=2000.0, noise=3.0)
    channels = 3

    def seen_body(self, body: torch.Tensor) -> torch.Tensor:
        """By the statistics of the wearers' rest bodies."""
        return self.normalised(body, "body")

    def fields(self, name: str, part: Part) -> torch.Tensor:
        """(V, 3, B_t): offsets from their mean in `unit_m`."""
        return self.units(part)


def mirrored(batch: Batch, mirror: np.ndarray) -> Batch:
    """The batch's offsets and masks with left and right exchanged.

    Args:
        mirror: (V,) vertex on the other side.
    """
    flip = np.array([-1, 1, 1], dtype=np.float32)
    return {
        **batch,
        "offsets": batch["offsets"][:, mirror] * flip,
        "mask": batch["mask"][:, mirror],
    }
