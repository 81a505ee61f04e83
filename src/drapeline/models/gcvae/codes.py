"""Datasets of garments through trained VAEs: to codes, and from codes to garments."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
import torch

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.dataset.splits import SPLITS
from drapeline.geometry.collision import resolve_penetration
from drapeline.geometry.mesh import faces_within
from drapeline.learning_data.moving import MovingFiles, MovingGarment
from drapeline.metrics.dynamic import Measured, measure_motion, moving_summary
from drapeline.metrics.static import (
    Prediction,
    StaticRows,
    Truth,
    measure_predictions,
    static_summary,
    with_kl,
)
from drapeline.metrics.table import MetricRow
from drapeline.models.gcvae.body_template import STATIC_CVAR, rest_bodies
from drapeline.models.gcvae.dynamic_garments import DynamicGarments
from drapeline.models.gcvae.loss import kl_nat
from drapeline.models.gcvae.vae import DynamicVae, GarmentVae, StaticVae
from drapeline.models.training.batches import Garments, as_tensors
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.dynamic_offsets import dressed
from drapeline.registration.to_body.topology import TOPOLOGIES, Topology
from drapeline.rule_log import progress
from drapeline.storage import load_npz, save_npz

SETTLED = "_settled"
_BATCH = 16


class StaticGarments(Garments, StaticRows, Protocol):
    """Registered garments in rest pose: what training reads and what evaluation reads."""


class Codes(NamedTuple):
    """Posteriors of (n,) garments.

    Attributes:
        mean, log_variance: (n, Z) float32.
    """

    mean: np.ndarray
    log_variance: np.ndarray

    def kl_nat(self) -> np.ndarray:
        """(n,) divergence of each from the standard normal, in nats."""
        return kl_nat(*map(torch.from_numpy, self)).numpy()

    def of(self, rows: np.ndarray) -> "Codes":
        """Those of some rows."""
        return Codes(self.mean[rows], self.log_variance[rows])


def encode_garments(model: GarmentVae, garments: Garments, rows: Sequence[int]) -> Codes:
    """Codes of rows of a dataset, in their order."""
    means, log_variances = [], []
    for start in range(0, len(rows), _BATCH):
        part = np.asarray(rows[start : start + _BATCH])
        batch = as_tensors(garments.batch(part))
        code = model.encode(batch)
        means.append(code.mean.numpy())
        log_variances.append(code.log_variance.numpy())
    return Codes(np.concatenate(means), np.concatenate(log_variances))


def decode_codes(
    model: GarmentVae, z: np.ndarray, cvar: np.ndarray, topology: np.ndarray
) -> Iterator[Prediction]:
    """Garments of codes, one by one: offsets (V, 3) in metres, and mask (V,) or None.

    Args:
        z: (n, Z).
        cvar: (n, C) conditions.
        topology: (n,) codes of `TOPOLOGIES`.
    """
    for start in range(0, len(z), _BATCH):
        part = slice(start, start + _BATCH)
        with torch.inference_mode():
            offsets, mask = model.decode(
                *(
                    torch.from_numpy(np.ascontiguousarray(x[part], dtype=dtype))
                    for x, dtype in ((z, np.float32), (cvar, np.float32), (topology, np.int64))
                )
            )
        inside = [None] * len(offsets) if mask is None else (mask > 0.5).numpy()
        yield from zip(offsets.numpy(), inside, strict=True)


def rest_body(model: StaticVae, cvar: np.ndarray) -> np.ndarray:
    """(V, 3) rest body of one condition (C,), metres."""
    basis = torch.from_numpy(model.body_template.body_basis)
    return rest_bodies(basis, torch.from_numpy(cvar.astype(np.float32))[None])[..., 0].numpy()


def static_truth(model: StaticVae, garments: StaticGarments) -> Truth:
    """The dataset as evaluation sees it, with the bodies and faces that the model knows."""
    faces = model.body_template.faces
    return Truth(
        garments.offsets,
        garments.mask,
        body=lambda row: rest_body(model, garments.cvar(np.array([row]))[0]),
        faces=lambda row: faces[TOPOLOGIES[int(garments.topology(np.array([row]))[0])]],
        body_faces=faces[TOPOLOGIES[0]],
    )


def measure_static(
    model: StaticVae, garments: StaticGarments, rows: np.ndarray, codes: Codes
) -> list[dict[str, float]]:
    """Every metric of the reconstructions of rows from the means of their codes (n, Z)."""
    decoded = decode_codes(model, codes.mean, garments.cvar(rows), garments.topology(rows))
    measures = measure_predictions(
        static_truth(model, garments), zip(rows.tolist(), decoded, strict=True)
    )
    return with_kl(measures, codes.kl_nat())


def static_vae_summary(
    model: StaticVae, garments: StaticGarments, codes: Codes, variant: str, splits: Sequence[str]
) -> list[MetricRow]:
    """Rows of the table of metrics for a trained static VAE.

    Args:
        codes: (N, Z) of all rows of the dataset.
        splits: to measure on.
    """
    seed = model.settings.training.seed
    found = []
    for split in splits:
        rows = garments.rows(split)
        measures = measure_static(model, garments, rows, codes.of(rows))
        found += static_summary(
            garments, rows, measures, model="svae", variant=variant, split=split, seed=seed
        )
    return found


def moving_points(
    model: DynamicVae,
    garments: DynamicGarments,
    rows: np.ndarray,
    moving: MovingGarment,
    body: BodyModel,
    z: np.ndarray,
    poses: np.ndarray | None = None,
) -> np.ndarray:
    """Registered points (n, M, 3) of one garment, decoded and put into poses.

    Args:
        rows: (n,) frames of the garment `moving`; they give the conditions.
        body: super-resolved, of the wearer's gender.
        z: (n, Z) wrinkle codes.
        poses: (n, 4, 72) of the frames and of three before each; those of the rows if None.
    """
    if poses is None:
        poses = garments.data.poses[rows]
    cvar = garments.cvar(rows)
    cvar[:, STATIC_CVAR : STATIC_CVAR + 72 * garments.frames] = poses[:, : garments.frames].reshape(
        len(rows), -1
    )
    decoded = decode_codes(model, z, cvar, garments.topology(rows))
    return dressed(
        moving.registered,
        np.stack([offsets for offsets, _ in decoded]),
        body,
        moving.shape,
        poses[:, 0],
        garments.data.version,
    )


def settled_points(
    moving: MovingGarment,
    body: BodyModel,
    topology: Topology,
    points: np.ndarray,
    poses: np.ndarray,
) -> np.ndarray:
    """Decoded points (n, M, 3) of one garment evened out and pushed out of its wearer.

    Args:
        body: super-resolved, of the wearer's gender.
        topology: of the super-resolved bodies.
        poses: (n, 72) rad.
    """
    registered = moving.registered
    number = np.cumsum(registered.mask) - 1  # of a covered vertex among the points
    faces = number[faces_within(topology.faces_of(moving.name), registered.mask)]
    return resolve_penetration(
        points, faces, posed_vertices(body, moving.shape, poses)[0], topology.faces
    )


def shown_points(
    model: DynamicVae,
    garments: DynamicGarments,
    rows: np.ndarray,
    moving: MovingGarment,
    body: BodyModel,
    topology: Topology,
    z: np.ndarray,
    poses: np.ndarray | None = None,
) -> np.ndarray:
    """Decoded points (n, M, 3) of one garment as pictures show them: settled if the model's are.

    Args:
        others: as for `moving_points` and `settled_points`.
    """
    points = moving_points(model, garments, rows, moving, body, z, poses)
    if not model.settles:
        return points
    poses = garments.data.poses[rows] if poses is None else poses
    return settled_points(moving, body, topology, points, poses[:, 0])


def rows_of(garments: DynamicGarments, moving: MovingGarment | MovingFiles) -> np.ndarray:
    """Rows of a dataset that are frames of one garment, in their order."""
    data = garments.data
    wearer = np.flatnonzero(
        (data.sample == moving.sample) & (data.garment == GARMENTS.index(moving.name))
    )
    return np.flatnonzero(np.isin(data.wearer, wearer))


def dynamic_vae_summary(
    model: DynamicVae,
    garments: DynamicGarments,
    movings: Mapping[str, Iterable[MovingGarment]],
    bodies: Mapping[str, BodyModel],
    topology: Topology,
    variant: str,
) -> list[MetricRow]:
    """Rows of the table of metrics for a trained dynamic VAE.

    One whose garments settle has rows of both: as decoded, and settled.

    Args:
        garments: every frame that is measured.
        movings: split -> the same garments with their simulation and their skinning weights.
        bodies: super-resolved, by gender.
    """
    seed = model.settings.training.seed
    found = []
    for split, held_out in movings.items():
        measured: dict[str, list[Measured]] = {}
        for moving in progress(held_out, label=split):
            rows, body = rows_of(garments, moving), bodies[moving.gender]
            codes = encode_garments(model, garments, rows)
            points = moving_points(model, garments, rows, moving, body, codes.mean)
            frames = garments.data.frame[rows]
            made = {variant: points}
            if model.settles:
                poses = moving.poses[frames]
                made[variant + SETTLED] = settled_points(moving, body, topology, points, poses)
            for name, cloth in made.items():
                measures = measure_motion(moving, frames, cloth, body, topology)
                own = Measured(moving.sample, moving.name, with_kl(measures, codes.kl_nat()))
                measured.setdefault(name, []).append(own)
        for name, own in measured.items():
            found += moving_summary(own, model="dvae", variant=name, split=split, seed=seed)
    return found


def save_codes(path: str | Path, codes: Codes, garments: StaticGarments) -> None:
    """Write the codes of all rows with their `garment`, `outfit` and `split`."""
    split = np.full(len(garments.garment), "", dtype="U5")
    for name in SPLITS:
        split[garments.rows(name)] = name
    save_npz(
        path,
        mean=codes.mean,
        log_variance=codes.log_variance,
        garment=np.asarray(garments.garment),
        outfit=np.asarray(garments.outfit),
        split=split,
    )


def load_codes(path: str | Path) -> tuple[Codes, dict[str, np.ndarray]]:
    """Codes (N, Z), and `garment`, `outfit` and `split` (N,) of the same rows.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    about = load_npz(path, "mean", "log_variance", "garment", "outfit", "split")
    return Codes(about.pop("mean"), about.pop("log_variance")), about
