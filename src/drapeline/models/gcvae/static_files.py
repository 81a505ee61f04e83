"""What the folder of a static model holds beside its checkpoint: all that its use takes.

With these files garments are sampled, and meshes encoded, without the data of the training.
"""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from drapeline.models.gcvae.codec import GarmentCodec
from drapeline.models.gcvae.codes import Codes, encode_garments
from drapeline.models.training.checkpoints import load_state, read_checkpoint
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.topology import Topology, save_topology
from drapeline.storage import load_npz, save_npz

if TYPE_CHECKING:
    from drapeline.models.gcvae.truth import StaticGarments

TRAINING_CODES, TOPOLOGY = "training_codes.npz", "topology.npz"


class TrainingCodes(NamedTuple):
    """The training garments of a model.

    Attributes:
        codes: of n garments.
        garment: (n,) their types, indices into `GARMENTS`.
        mask_rate: (K, V) share of each type's garments that cover a vertex.
    """

    codes: Codes
    garment: np.ndarray
    mask_rate: np.ndarray


def save_static_files(
    folder: Path, model: GarmentCodec, garments: "StaticGarments", topology: Topology
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
    "mask_rate": f"float {len(GARMENTS)} *",
}


def load_training_codes(folder: str | Path) -> TrainingCodes:
    """Read what `save_static_files` wrote of the training garments.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    found = load_npz(Path(folder) / TRAINING_CODES, _CODES)
    codes = Codes(found["mean"], found["log_variance"])
    return TrainingCodes(codes, found["garment"], found["mask_rate"])
