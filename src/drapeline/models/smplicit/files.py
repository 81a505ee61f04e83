"""What the folder of a trained model holds beside its checkpoint: all that its use takes."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from drapeline.bodies.model import BodyModel, save_body
from drapeline.frames import GENDERS
from drapeline.learning_data.garment_fields import FieldData
from drapeline.models.smplicit.network import GarmentField
from drapeline.models.training.checkpoints import load_state, read_checkpoint
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import GARMENTS
from drapeline.storage import load_npz, save_npz

TRAINING_CODES = "training_codes.npz"


class TrainingCodes(NamedTuple):
    """The training garments of a model.

    Attributes:
        z: (n, cut + style) codes.
        garment: (n,) types, indices into `GARMENTS`.
        outfit: (n,) names of their outfits.
        shape: (n, 10) of the wearers.
        gender: (n,) of the wearers, 0 female, 1 male.
    """

    z: np.ndarray
    garment: np.ndarray
    outfit: np.ndarray
    shape: np.ndarray
    gender: np.ndarray


def body_file(folder: str | Path, gender: str) -> Path:
    """Where the folder keeps the body of a gender."""
    return Path(folder) / f"{gender}.npz"


def save_model_files(
    folder: Path, model: GarmentField, data: FieldData, bodies: Mapping[str, BodyModel]
) -> None:
    """Complete the folder of a training.

    Args:
        folder: with the checkpoint.
        model: that was trained; gets the weights of the checkpoint, which are the best ones.
        data: that it was trained on.
        bodies: by gender.
    """
    load_state(model, read_checkpoint(folder / BEST), folder / BEST)
    model.eval()
    rows = data.rows("train")
    with torch.no_grad():
        z_cut = model.encoder(torch.from_numpy(data.occlusion[rows]).to(model.device))
        z = torch.cat([z_cut, model.styles[torch.from_numpy(rows)]], 1)
    save_npz(
        folder / TRAINING_CODES,
        z=z.cpu().numpy(),
        garment=data.garment[rows],
        outfit=data.outfit[rows],
        shape=data.shape[rows],
        gender=data.gender[rows],
    )
    for gender, body in bodies.items():
        save_body(body_file(folder, gender), body)


_CODES = {
    "z": "float n *",
    "garment": f"int<{len(GARMENTS)} n",
    "outfit": "str n",
    "shape": "float n 10",
    "gender": f"int<{len(GENDERS)} n",
}


def load_training_codes(folder: str | Path) -> TrainingCodes:
    """Read what `save_model_files` wrote of the training garments.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    return TrainingCodes(**load_npz(Path(folder) / TRAINING_CODES, _CODES))
