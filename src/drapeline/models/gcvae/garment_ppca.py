"""Garments as masked probabilistic PCA: codes and decoder in closed form, nothing is trained.

Not in the paper, and what its networks are to be compared with. A garment has no offsets outside
its mask; the fit takes them for missing instead of zero, so that no hem is a jump in the field, see
`ppca`. Encoding is the exact posterior; decoding needs only z and the conditions.
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar, Protocol

import numpy as np
import torch

from drapeline.manifest import write_manifest
from drapeline.models.gcvae.body_template import BodyTemplate
from drapeline.models.gcvae.codec import GarmentCodec, Garments, Part, conditions_of
from drapeline.models.gcvae.networks import Code
from drapeline.models.gcvae.ppca import Ppca, blur_mask, fit_ppca
from drapeline.models.gcvae.settings import PpcaSettings
from drapeline.models.layers.graphs import SparseMatrix, scaled_laplacian
from drapeline.models.training.batches import Batch, as_tensors, refuse_unfinite
from drapeline.models.training.checkpoints import write_checkpoint
from drapeline.models.training.module import BEST, SETTINGS
from drapeline.registration.to_body.super_body import mirror_of
from drapeline.registration.to_body.topology import TOPOLOGIES
from drapeline.seeding import rng_for
from drapeline.storage import atomic_folder, write_json


class MirroredGarments(Garments, Protocol):
    """Garments whose mirror images are garments as well."""

    def mirrored_cvar(self, rows: np.ndarray) -> np.ndarray:
        """(n, C) conditions of the rows' mirror images."""


@dataclass(frozen=True)
class PpcaConstants:
    """Constants of the fit.

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
    steepness: float = 6.0


class GarmentPpca(GarmentCodec):
    """What the fits of garments at rest and in motion share.

    Attributes:
        constants: of the fit.
        channels: of a field: offsets, and the ramp of the mask where there is one.
    """

    model = "ppca"
    SETTINGS = PpcaSettings
    constants: ClassVar[PpcaConstants]
    channels: ClassVar[int]

    def __init__(self, settings: PpcaSettings, body_template: BodyTemplate) -> None:
        super().__init__(settings, body_template)
        vertices = len(body_template.offset_mean)
        count = min(self.constants.vertices_max, vertices)
        rng_observed = rng_for(settings.seed, "posterior")
        observed = np.sort(rng_observed.permutation(vertices)[:count])
        self.ppca = Ppca(
            vertices,
            len(body_template.cvar_mean),
            settings.latent,
            torch.from_numpy(observed),
            self.channels,
        )
        self.laplacians = torch.nn.ModuleDict(
            {
                name: SparseMatrix(scaled_laplacian(body_template.edges[name][0], vertices))
                for name in TOPOLOGIES
            }
        )
        for moment in ("mean", "std"):
            self._constant(f"cvar_{moment}")

    @property
    def latent(self) -> int:
        """Numbers of a code."""
        return self.settings.latent

    @property
    def seed(self) -> int:
        """Of the rows and the vertices that are chosen."""
        return self.settings.seed

    @torch.no_grad()
    def fit(self, garments: MirroredGarments) -> None:
        """Fit to the training rows and their mirror images.

        Raises:
            InputError: offsets are not finite; names the samples.
        """
        rows = garments.rows("train")
        if len(rows) > self.constants.rows_max:
            rng = rng_for(self.settings.seed, "linear rows")
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
            latent=self.latent,
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
        """The exact posterior."""
        pairs = [
            self.ppca.posterior(
                self.fields(name, part), part.mask, self._normalise_conditions(part.cvar)
            )
            for name, part in parts.items()
        ]
        mean, log_variance = (torch.cat(half) for half in zip(*pairs, strict=True))
        return Code(mean, log_variance, mean[:, :0])

    def decode_parts(
        self, z: torch.Tensor, cvar: torch.Tensor, counts: Mapping[str, int]
    ) -> dict[str, torch.Tensor]:
        """Topology -> (V, channels, B_t) normalised offsets and any mask logit."""
        field = self.ppca(z, self._normalise_conditions(cvar))
        metres = field[:, :3] * self.constants.unit_m + self.offset_mean[..., None]
        logit = field[:, 3:] * (self.constants.steepness / self.constants.ramp_weight)
        made = torch.cat([self.normalise(metres, "offset"), logit], 1)
        return dict(zip(counts, made.split(list(counts.values()), 2), strict=True))

    @abstractmethod
    def fields(self, name: str, part: Part) -> torch.Tensor:
        """(V, channels, B_t) of garments of topology `name`."""

    def offsets_in_units(self, part: Part) -> torch.Tensor:
        """(V, 3, B_t) offsets from their mean, in `unit_m`."""
        return (part.offsets - self.offset_mean[..., None]) / self.constants.unit_m

    def _normalise_conditions(self, cvar: torch.Tensor) -> torch.Tensor:
        return (cvar - self.cvar_mean) / self.cvar_std


class StaticPpca(GarmentPpca):
    """Garments at rest. The mask is a fourth channel: a ramp across the hem."""

    checkpoint_type = "static_ppca"
    constants = PpcaConstants()
    channels = 4

    def fields(self, name: str, part: Part) -> torch.Tensor:
        """(V, 4, B_t): offsets from their mean in `unit_m`, and the ramp of the mask."""
        ramp = blur_mask(part.mask, self.laplacians[name], self.constants.blur_passes)
        return torch.cat(
            [self.offsets_in_units(part), self.constants.ramp_weight * ramp[:, None]], 1
        )


class DynamicPpca(GarmentPpca):
    """Garments in motion. The mask is that of the static garment, so a field is offsets alone.

    A few sequences say little about what poses and static codes do to cloth, so the regression on
    them is penalised more. Their frames are alike, so the posterior assumes more noise; otherwise
    codes of new frames would lie far outside the prior.
    """

    checkpoint_type = "dynamic_ppca"
    resolves_penetration = True
    constants = PpcaConstants(ridge=2000.0, noise=3.0)
    channels = 3

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


def save_fit(
    folder: str | Path, ppca: GarmentPpca, complete: Callable[[Path], None] | None = None
) -> None:
    """Leave a folder like that of a training, with a checkpoint and settings but no history.

    Args:
        folder: to write.
        ppca: fitted.
        complete: adds files to the folder, which has all others by then.
    """
    with atomic_folder(folder) as scratch:
        write_checkpoint(scratch / BEST, ppca.state_dict(), ppca.checkpoint_metadata())
        write_json(
            scratch / SETTINGS,
            {
                "checkpoint_type": ppca.checkpoint_type,
                **ppca.settings.plain(),
                "constants": asdict(ppca.constants),
            },
        )
        if complete is not None:
            complete(scratch)
        write_manifest(scratch)
