"""A trained model as users of the library take it: codes in, meshes out.

    from drapeline.models.load import load

    upper = load("results/smplicit/upper")
    garment = upper.decode(upper.codes.z[0], gender="female", shape=[0.0] * 10)

Everything comes from the folder that the training left. Meshes are in metres, in the rest pose,
with the root joint at the origin, Z up, facing -Y. The numbers of a code are z_cut followed by
z_style.
"""

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from drapeline.bodies.model import BodyModel, keep_body, load_kept_body
from drapeline.bodies.rest_body import SHAPES, rest_body
from drapeline.errors import InputError
from drapeline.frames import GENDERS, gender_codes, gender_names
from drapeline.geometry.mesh import Mesh
from drapeline.learning_data.garment_fields import FieldData
from drapeline.models.smplicit.garments import FIELD_MODELS
from drapeline.models.smplicit.latent import draw_between
from drapeline.models.smplicit.network import GarmentField, load_field
from drapeline.models.smplicit.settings import Meshing
from drapeline.models.smplicit.surface.fields import NetworkField
from drapeline.models.smplicit.surface.sheet import FieldGarment, garment_of_field
from drapeline.models.training.checkpoints import load_state, read_checkpoint
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import GARMENTS
from drapeline.seeding import rng_for
from drapeline.storage import load_npz, save_npz

TRAINING_CODES = "training_codes.npz"


class SmplicitModel:
    """Garments of some types as codes of a distance field.

    Args:
        folder: of the training, such as `results/smplicit/upper`.

    Attributes:
        name: of `FIELD_MODELS`.
        garments: the types that it was trained on.
        network: in torch, see `GarmentField`.
        codes: of the training garments.

    Raises:
        InputError: a file is missing or damaged, or holds another model.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.network = load_field(folder)
        self.codes = load_training_codes(folder)
        self.name = self.network.name
        self.garments, self.box = FIELD_MODELS[self.name][:2]

    @property
    def latent(self) -> int:
        """Numbers of a code."""
        return self.codes.z.shape[1]

    @property
    def mean_code(self) -> np.ndarray:
        """(cut + style,) mean of the training garments' codes."""
        return self.codes.z.mean(axis=0)

    def codes_of(self, garment: str) -> np.ndarray:
        """(n, cut + style) codes of the training garments of a type; of all if there are none."""
        own = self.codes.garment == GARMENTS.index(garment)
        return self.codes.z[own] if own.any() else self.codes.z

    @cached_property
    def bodies(self) -> dict[str, BodyModel]:
        """The bodies that it was trained on, by gender."""
        files = {gender: body_file(self.folder, gender) for gender in GENDERS}
        return {gender: load_kept_body(file, gender) for gender, file in files.items()}

    def sample(self, count: int, *, seed: int = 0) -> np.ndarray:
        """(count, cut + style) codes of new garments; see `draw_between`."""
        return draw_between(self.codes.z, self.codes.garment, rng_for(seed, "samples"), count)

    def field(
        self, z: np.ndarray, *, gender: str, shape: Sequence[float] | np.ndarray
    ) -> NetworkField:
        """The distance field of a code on a body.

        Args:
            z: (cut + style,) code.
            gender: of the wearer, "female" or "male".
            shape: (10,) of the wearer.

        Raises:
            InputError: the code or the shape has another length or is not finite, or there is no
                such gender.
        """
        z = finite("code", z, self.latent)
        check_gender(gender)
        return NetworkField(self.network, z, finite("shape", shape, SHAPES), gender)

    def decode(
        self,
        z: np.ndarray,
        *,
        gender: str,
        shape: Sequence[float] | np.ndarray,
        meshing: Meshing | None = None,
    ) -> FieldGarment:
        """The garment of a code on a body; see `field` for arguments and errors."""
        field = self.field(z, gender=gender, shape=shape)
        body = Mesh(rest_body(self.bodies[gender], np.asarray(shape)), self.bodies[gender].faces)
        return garment_of_field(field, self.box, body, meshing or Meshing())


def check_gender(gender: str) -> None:
    """Refuse other genders than the bodies'.

    Raises:
        InputError: there is no such gender.
    """
    if gender not in GENDERS:
        raise InputError(f"gender: '{gender}', expected one of {', '.join(GENDERS)}")


def finite(name: str, values: Sequence[float] | np.ndarray, size: int) -> np.ndarray:
    """(size,) float32 numbers.

    Raises:
        InputError: they are not finite, or not as many.
    """
    array = np.asarray(values, dtype=np.float32)
    if array.shape != (size,) or not np.isfinite(array).all():
        raise InputError(f"{name}: shape {array.shape}, expected {size} finite numbers")
    return array


class GarmentCodes(NamedTuple):
    """The training garments of a model."""

    z: np.ndarray  # (n, cut + style) codes
    garment: np.ndarray  # (n,) types, indices into `GARMENTS`
    outfit: np.ndarray  # (n,) names of their outfits
    shape: np.ndarray  # (n, 10) of the wearers
    gender: np.ndarray  # (n,) of the wearers, "female" or "male"


def body_file(folder: str | Path, gender: str) -> Path:
    """Path of the body of a gender in a model's folder."""
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
        gender=gender_codes(data.gender[rows]),
    )
    for gender, body in bodies.items():
        keep_body(body_file(folder, gender), body, gender)


_CODES = {
    "z": "float n *",
    "garment": f"int<{len(GARMENTS)} n",
    "outfit": "str n",
    "shape": "float n 10",
    "gender": f"int<{len(GENDERS)} n",
}


def load_training_codes(folder: str | Path) -> GarmentCodes:
    """Read what `save_model_files` wrote of the training garments.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    arrays = load_npz(Path(folder) / TRAINING_CODES, _CODES)
    return GarmentCodes(**arrays | {"gender": gender_names(arrays["gender"])})
