"""Garments as masked probabilistic PCA: codes and decoder in closed form, nothing is trained.

Not in the paper, and what its networks are to be compared with. A field is the offsets of a
garment's vertices. Outside the garment's mask there is no offset. Read as zero, as plain PCA has
to, every hem and every end of a sleeve is a jump in the field that costs components; read as
missing, the field is smooth, and what it would be beyond the hem is inferred. The mask itself can
enter as a further channel: blurred over the mesh it becomes a ramp, which is zero at the hem.
Encoding is the exact posterior; decoding needs only z and the conditions, by a linear regression.

After Tipping and Bishop, "Probabilistic principal component analysis", 1999.
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
import torch
from torch import nn

from drapeline.learning_data.training_rows import (
    MirroredGarments,
    linear_rows,
    with_mirror_images,
)
from drapeline.manifest import write_manifest
from drapeline.models.gcvae.codec import GarmentCodec, TopologyBatch, conditions_of
from drapeline.models.gcvae.data import BodyTemplate
from drapeline.models.gcvae.networks import Code
from drapeline.models.gcvae.settings import PpcaSettings
from drapeline.models.layers.graphs import SparseMatrix, scaled_laplacian
from drapeline.models.training.batches import Batch, as_tensors, refuse_unfinite
from drapeline.models.training.checkpoints import write_checkpoint
from drapeline.models.training.module import BEST, SETTINGS
from drapeline.registration.to_body.topology import TOPOLOGIES
from drapeline.seeding import rng_for
from drapeline.storage import atomic_folder, write_json

_GRAM_ROWS = 256  # of a symmetric product at once, of which half is left out


class PpcaFit(NamedTuple):
    """Parameters of y = regression(c) + basis z + noise, with z standard normal."""

    regression: torch.Tensor  # (C + 1, V * channels) from conditions and a one
    basis: torch.Tensor  # (Z, V * channels)
    noise: torch.Tensor  # () variance that the basis leaves unexplained


def blur_mask(mask: torch.Tensor, laplacian: SparseMatrix, passes: int) -> torch.Tensor:
    """Average a mask over the graph until it is a ramp from -1 outside to 1 inside.

    Args:
        mask: (V, B) bool.
        laplacian: scaled and normalised; half of (1 - laplacian) is a stable averaging step.
        passes: number of steps.

    Returns:
        (V, B), zero at the mask's edge.
    """
    x = mask.to(laplacian.forward_value.dtype)
    total = torch.ones_like(x[:, :1])
    both = torch.cat([x, total], 1)
    for _ in range(passes):
        both = 0.5 * (both - laplacian(both))
    return 2 * both[:, :-1] / both[:, -1:] - 1


def append_one(conditions: torch.Tensor) -> torch.Tensor:
    """(n, C) -> (n, C + 1)."""
    return torch.cat([conditions, conditions.new_ones(len(conditions), 1)], 1)


def fit_ppca(
    fields: torch.Tensor,
    known: torch.Tensor,
    conditions: torch.Tensor,
    *,
    latent: int,
    rounds: int,
    ridge: float,
) -> PpcaFit:
    """Fit by turns: fill in what is missing, fit to the filled fields, and so on.

    Args:
        fields: (n, V * channels), arbitrary where not known.
        known: (n, V * channels) bool.
        conditions: (n, C) of zero mean and unit deviation.
        latent: size of z; components beyond those that n samples span are zero.
        rounds: of filling in.
        ridge: weight of the regression's penalty, counted in samples.
    """
    filled = torch.where(known, fields, 0)
    one = append_one(conditions)
    penalty = ridge * torch.eye(one.shape[1], dtype=one.dtype, device=one.device)
    penalty[-1, -1] = 0
    solve = torch.linalg.solve(one.T @ one + penalty, one.T)
    count = min(latent, len(fields) - 1)
    near = None
    for number in range(rounds):
        regression = solve @ filled
        mean = one @ regression
        residual = filled - mean
        near = None if number == rounds - 1 else near  # the last round is exact
        values, near, rows = principal_rows(residual, near, count)
        variance = torch.linalg.vector_norm(residual, dim=1).double().square().mean()
        noise = ((variance - values.sum()) / fields.shape[1]).clamp_min(0)
        # Each direction shrinks by the share of its variance that is noise.
        kept = ((values - noise) / values).nan_to_num().clamp_min(0).to(near.dtype)
        filled = torch.where(known, fields, mean.addmm_(near * kept, rows), out=filled)
    size = ((values - noise).clamp_min(0) / (len(residual) * values)).nan_to_num()
    basis = torch.zeros(latent, fields.shape[1], dtype=residual.dtype, device=residual.device)
    basis[:count] = size.sqrt().to(rows.dtype)[:, None] * rows
    return PpcaFit(regression, basis, noise.to(residual.dtype).clamp_min(1e-6))


def principal_rows(
    fields: torch.Tensor, near: torch.Tensor | None, count: int
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Largest eigenvalues of F F^T / n, their eigenvectors U and U^T F.

    Args:
        fields: F, (n, V * channels).
        near: (n, count) eigenvectors of fields that differ little, for one step of subspace
            iteration from there (Halko et al. 2011, algorithm 4.4); exact if None.
        count: at most n.

    Returns:
        (count,) float64, (n, count) and (count, V * channels).
    """
    if near is not None:
        near, _ = torch.linalg.qr(fields @ (fields.T @ near))
    rows = fields if near is None else near.T @ fields
    values, vectors = torch.linalg.eigh(_gram(rows).double() / len(fields))
    values, vectors = values.flip(0)[:count], vectors.flip(1)[:, :count].to(fields.dtype)
    return values, vectors if near is None else near @ vectors, vectors.T @ rows


def _gram(rows: torch.Tensor) -> torch.Tensor:
    """(n, n) R R^T of rows (n, W), filled in on and below the diagonal, where `eigh` reads it."""
    gram = rows.new_zeros(len(rows), len(rows))
    for start in range(0, len(rows), _GRAM_ROWS):
        end = start + _GRAM_ROWS
        torch.mm(rows[start:end], rows[:end].T, out=gram[start:end, :end])
    return gram


class Ppca(nn.Module):
    """A fit as a module: the exact posterior of a field, and the field of a code.

    Args:
        vertices: V.
        conditions: C.
        latent: Z, size of z.
        observed: (S,) vertices that the posterior looks at.
        channels: of the fields: three of offsets, and others that are known everywhere.
    """

    def __init__(
        self, vertices: int, conditions: int, latent: int, observed: torch.Tensor, channels: int
    ) -> None:
        super().__init__()
        self.channels = channels
        width = vertices * channels
        self.regression: torch.Tensor
        self.basis: torch.Tensor
        self.noise: torch.Tensor
        self.observed: torch.Tensor
        self.register_buffer("regression", torch.zeros(conditions + 1, width))
        self.register_buffer("basis", torch.zeros(latent, width))
        self.register_buffer("noise", torch.ones(()))
        self.register_buffer("observed", observed, persistent=False)

    def set_fit(self, fit: PpcaFit) -> None:
        """Copy the parameters of a fit."""
        for name, value in fit._asdict().items():
            getattr(self, name).copy_(value)

    def forward(self, z: torch.Tensor, conditions: torch.Tensor) -> torch.Tensor:
        """(B, Z) and (B, C) -> mean fields (V, channels, B)."""
        field = append_one(conditions) @ self.regression + z @ self.basis
        return field.T.unflatten(0, (-1, self.channels))

    def posterior(
        self, fields: torch.Tensor, mask: torch.Tensor, conditions: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean and log variance (B, Z) of z given what is known of the fields.

        Args:
            fields: (V, channels, B).
            mask: (V, B): where the first three channels are known; any others always are.
            conditions: (B, C).
        """
        latent = len(self.basis)
        basis = self.basis.unflatten(1, (-1, self.channels))[:, self.observed]  # (Z, S, channels)
        zero = conditions.new_zeros(len(conditions), latent)
        residual = (fields - self(zero, conditions))[self.observed]
        field = basis[..., 3:].flatten(1)  # (Z, S * others)
        always = field @ field.T
        mean = residual.new_zeros(latent, len(conditions))
        variance = torch.zeros_like(mean)
        # Frames of a garment share its mask, and so their precision.
        masks, which = torch.unique(mask[self.observed], dim=1, return_inverse=True)
        for number, inside in enumerate(masks.T):
            own = which == number
            offsets = basis[:, inside, :3].flatten(1)  # (Z, 3 M)
            precision = (always + offsets @ offsets.T) / self.noise
            precision.diagonal().add_(1)
            seen = offsets @ residual[inside, :3][..., own].flatten(0, 1) + field @ residual[
                :, 3:, own
            ].flatten(0, 1)
            root = torch.linalg.cholesky(precision)
            mean[:, own] = torch.cholesky_solve(seen / self.noise, root)
            variance[:, own] = torch.cholesky_inverse(root).diagonal()[:, None]
        return mean.T, variance.T.log()


@dataclass(frozen=True)
class PpcaConstants:
    """Constants of the fit; docs/background/garment-vae.md has what validation says of them."""

    unit_m: float = 0.02  # unit of the offsets in a field
    # That turn the mask into a ramp, whose width grows with their square root.
    blur_passes: int = 10
    ramp_weight: float = 0.7  # of the mask's channel against offsets in `unit_m`
    rounds: int = 10  # of filling in what is missing
    ridge: float = 20.0  # penalty of the regression on the conditions, counted in samples
    # Least variance that the posterior assumes of every number, in `unit_m` squared. It is more
    # than the fit leaves of the training rows: neighbouring vertices err alike, so they are less
    # evidence than their number, and new garments vary in ways that no component has.
    noise: float = 0.1
    vertices_max: int = 3000  # the posterior looks at no more vertices, chosen at random
    steepness: float = 6.0  # of the mask's logit against its ramp


class GarmentPpca(GarmentCodec[TopologyBatch]):
    """Base class of the fits of garments at rest and in motion.

    Attributes:
        constants: of the fit.
        channels: of a field: offsets, and the ramp of the mask where there is one.
        conditioned: whether fields are regressed on the conditions.
    """

    model = "ppca"
    SETTINGS = PpcaSettings
    constants: ClassVar[PpcaConstants]
    channels: ClassVar[int]
    conditioned: ClassVar[bool] = True
    cvar_mean: torch.Tensor
    cvar_std: torch.Tensor
    laplacians: Any

    def __init__(self, settings: PpcaSettings, body_template: BodyTemplate) -> None:
        super().__init__(settings, body_template)
        vertices = len(body_template.body_mean)
        count = min(self.constants.vertices_max, vertices)
        rng_observed = rng_for(self.seed, "posterior")
        observed = np.sort(rng_observed.permutation(vertices)[:count])
        self.ppca = Ppca(
            vertices,
            len(body_template.cvar_mean) if self.conditioned else 0,
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
        """Seed of the rows and the vertices that are chosen."""
        return self.settings.seed

    @torch.no_grad()
    def fit(self, garments: MirroredGarments) -> None:
        """Fit to the training rows and their mirror images.

        Raises:
            InputError: offsets are not finite; names the samples.
        """
        rows = linear_rows(garments, "train", self.seed)
        batches = with_mirror_images(garments, rows, self.body_template.mirror)
        refuse_unfinite(batches[0]["offsets"], batches[0]["names"], "offsets")
        seen = map(self._known_fields, batches)
        fields, known, conditions = (torch.cat(parts) for parts in zip(*seen, strict=True))
        fit = fit_ppca(
            fields,
            known,
            conditions,
            latent=self.latent,
            rounds=self.constants.rounds,
            ridge=self.constants.ridge,
        )
        self.ppca.set_fit(fit._replace(noise=fit.noise.clamp_min(self.constants.noise)))

    def first(self, count: int) -> "GarmentPpca":
        """The same fit with its first components alone, by falling variance, ready to encode.

        Its codes are not the first numbers of the longer ones: the posterior looks at these alone.
        """
        cut = type(self)(self.settings.replace(latent=count), self.body_template)
        whole = self.ppca
        cut.ppca.set_fit(PpcaFit(whole.regression, whole.basis[:count], whole.noise))
        return cut.eval()

    def _known_fields(self, batch: Batch) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Fields (n, V * channels), where they are known, and normalised conditions (n, C)."""
        parts = self.parts(as_tensors(batch))
        fields = torch.cat([self.fields(name, part) for name, part in parts.items()], 2)
        mask = torch.cat([part.mask for part in parts.values()], 1)
        known = mask[:, None].repeat(1, self.channels, 1)
        known[:, 3:] = True
        flat, seen = (x.flatten(0, 1).T.contiguous() for x in (fields, known))
        return flat, seen, self._normalise_conditions(conditions_of(parts)[0])

    def part(self, name: str, batch: Batch, rows: torch.Tensor) -> TopologyBatch:
        """The samples of a batch in rows of topology `name`."""
        return TopologyBatch.of(batch, rows)

    def encode_parts(self, parts: Mapping[str, TopologyBatch]) -> Code:
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
        logit = field[:, 3:] * (self.constants.steepness / self.constants.ramp_weight)
        made = torch.cat([field[:, :3] * self.constants.unit_m, logit], 1)
        parts = dict(zip(counts, made.split(list(counts.values()), 2), strict=True))
        return {
            name: torch.cat([part[:, :3] / self.offset_moments(name)[1], part[:, 3:]], 1)
            for name, part in parts.items()
        }

    @abstractmethod
    def fields(self, name: str, part: TopologyBatch) -> torch.Tensor:
        """(V, channels, B_t) of garments of topology `name`."""

    def offsets_in_units(self, name: str, part: TopologyBatch) -> torch.Tensor:
        """(V, 3, B_t) offsets from the mean of topology `name`, in `unit_m`."""
        return (part.offsets - self.offset_moments(name)[0]) / self.constants.unit_m

    def _normalise_conditions(self, cvar: torch.Tensor) -> torch.Tensor:
        return (cvar - self.cvar_mean) / self.cvar_std if self.conditioned else cvar[:, :0]


class StaticPpca(GarmentPpca):
    """Garments at rest. The mask is a fourth channel: a ramp across the hem."""

    checkpoint_type = "static_ppca"
    constants = PpcaConstants()
    channels = 4

    def fields(self, name: str, part: TopologyBatch) -> torch.Tensor:
        """(V, 4, B_t): offsets from their mean in `unit_m`, and the ramp of the mask."""
        ramp = blur_mask(part.mask, self.laplacians[name], self.constants.blur_passes)
        return torch.cat(
            [self.offsets_in_units(name, part), self.constants.ramp_weight * ramp[:, None]], 1
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

    def fields(self, name: str, part: TopologyBatch) -> torch.Tensor:
        """(V, 3, B_t): offsets from their mean in `unit_m`."""
        return self.offsets_in_units(name, part)


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
