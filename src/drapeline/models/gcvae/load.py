"""Models of this room, and their data, from files.

The folder of a static model holds all that its use takes: with its files garments are sampled, and
meshes encoded, without the data of the training.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from drapeline.errors import InputError
from drapeline.learning_data.dynamic import DynamicData
from drapeline.models.gcvae.codec import Codes, GarmentCodec, encode_garments, encode_rows
from drapeline.models.gcvae.data import BodyTemplate, DynamicGarments, StaticGarments
from drapeline.models.gcvae.ppca import DynamicPpca, StaticPpca
from drapeline.models.gcvae.vae import DynamicVae, StaticVae
from drapeline.models.gcvae.wrinkle_mlp import WrinkleMlp
from drapeline.models.training.checkpoints import building, load_state, read_checkpoint
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.topology import Topology, save_topology
from drapeline.storage import load_npz, save_npz

_CLASSES: dict[str, type[GarmentCodec]] = {
    cls.checkpoint_type: cls for cls in (StaticVae, DynamicVae, StaticPpca, DynamicPpca, WrinkleMlp)
}


def load_codec(path: str | Path) -> GarmentCodec:
    """A trained VAE or a fitted PCA, ready to encode and decode.

    Args:
        path: of a checkpoint.

    Raises:
        InputError: see `read_checkpoint`; or the checkpoint is of another type of network.
    """
    checkpoint = read_checkpoint(path)
    metadata = checkpoint.metadata
    checkpoint_type = metadata["checkpoint_type"]
    if checkpoint_type not in _CLASSES:
        raise InputError(
            f"{path}: holds a '{checkpoint_type}' network, expected {' or '.join(_CLASSES)}"
        )
    cls = _CLASSES[checkpoint_type]
    with building(path):
        template = BodyTemplate.from_tensors(metadata["body_template"])
        model = cls(cls.SETTINGS(**metadata["settings"]), template)
    load_state(model, checkpoint, path)
    return model.eval()


TRAINING_CODES, TOPOLOGY = "training_codes.npz", "topology.npz"


class TrainingCodes(NamedTuple):
    """The training garments of a model."""

    codes: Codes  # of n garments
    garment: np.ndarray  # (n,) their types, indices into `GARMENTS`
    cvar: np.ndarray  # (n, C) their conditions
    mask_rate: np.ndarray  # (K, V) share of each type's garments that cover a vertex


def save_static_files(
    folder: Path, model: GarmentCodec, garments: StaticGarments, topology: Topology
) -> None:
    """Complete the folder of a training or a fit.

    Args:
        folder: with the checkpoint.
        model: that was trained; gets the weights of the checkpoint, which are the best ones.
        garments: that it was trained on.
        topology: of the bodies.
    """
    load_state(model, read_checkpoint(folder / BEST), folder / BEST)
    rows = garments.rows("train")
    codes = encode_garments(model.eval(), garments, rows)
    garment = np.asarray(garments.garment)
    save_npz(
        folder / TRAINING_CODES,
        mean=codes.mean,
        log_variance=codes.log_variance,
        garment=garment[rows],
        cvar=garments.cvar(rows),
        mask_rate=mask_rates(garment, garments.mask, rows),
    )
    save_topology(folder / TOPOLOGY, topology)


def mask_rates(garment: np.ndarray, mask: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(K, V) float32 share of each type's garments, among some rows, that cover a vertex.

    Args:
        garment: (N,) types, indices into `GARMENTS`.
        mask: (N, V) bool; may be memory-mapped.
        rows: of garments.
    """
    total = np.zeros((len(GARMENTS), mask.shape[1]))
    for row in rows:
        total[garment[row]] += mask[row]
    count = np.bincount(garment[rows], minlength=len(GARMENTS))
    return (total / np.maximum(count, 1)[:, None]).astype(np.float32)


_CODES = {
    **dict.fromkeys(("mean", "log_variance"), "float n z"),
    "garment": f"int<{len(GARMENTS)} n",
    "cvar": "float n *",
    "mask_rate": f"float {len(GARMENTS)} *",
}


def load_training_codes(folder: str | Path) -> TrainingCodes:
    """Read what `save_static_files` wrote of the training garments.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    arrays = load_npz(Path(folder) / TRAINING_CODES, _CODES)
    codes = Codes(arrays["mean"], arrays["log_variance"])
    return TrainingCodes(codes, *(arrays[key] for key in ("garment", "cvar", "mask_rate")))


def load_dynamic_garments(folder: str | Path, static: str | Path, frames: int) -> DynamicGarments:
    """Frames with their conditions.

    Args:
        folder: of the rule `collect_dynamic`.
        static: folder of the trained SVAE that gives z_s.
        frames: f, the number of poses in the conditions, 1 to 4.

    Raises:
        InputError: a file is missing or damaged.
    """
    data, model = DynamicData(folder), load_codec(Path(static) / BEST)
    codes = encode_rows(model, data.static_batch, np.arange(len(data.garment)))
    return DynamicGarments(data, codes.mean, frames)
