"""A trained displacement as users of the library take it: poses in, moved cloth out.

from drapeline.models.load import load
from drapeline.models.smplicit.repose import repose

upper, wrinkles = load("results/smplicit/upper"), load("results/smplicit/displacement/upper")
wearer = {"gender": "female", "shape": [0.0] * 10}
garment = upper.decode(upper.mean_code, **wearer).sheet
cloth = repose(
    garment,
    upper.bodies["female"],
    wearer["shape"],
    poses,
    skinning="smoothed",
    displacement=wrinkles.worn_by(**wearer),
)
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drapeline.bodies.rest_body import SHAPES
from drapeline.frames import GENDERS
from drapeline.models.smplicit.load_displacement import load_displacement
from drapeline.models.smplicit.model import check_gender, finite
from drapeline.models.smplicit.worn_displacement import WornDisplacement


class PoseDisplacement:
    """P(p, theta, z_theta) of the garments of a model (SMPLicit 3.5).

    Args:
        folder: of the training, such as `results/smplicit/displacement/upper`.

    Attributes:
        name: of `FIELD_MODELS`.
        network: in torch, see `DisplacementField`.

    Raises:
        InputError: the checkpoint is missing, damaged, or of another model.
    """

    def __init__(self, folder: str | Path) -> None:
        self.network = load_displacement(folder)
        self.name = self.network.name

    @property
    def codes(self) -> np.ndarray:
        """(n, code) z_theta of the garments in the data that it was trained on."""
        return self.network.codes.numpy()

    def worn_by(
        self, *, gender: str, shape: Sequence[float], z: Sequence[float] | None = None
    ) -> WornDisplacement:
        """What `repose` takes for a wearer.

        Args:
            gender: of the wearer, "female" or "male".
            shape: (10,) of the wearer.
            z: (code,) z_theta; None is zero, which stands for garments that it was not trained on.

        Raises:
            InputError: the code or the shape has another length or is not finite, or there is no
                such gender.
        """
        check_gender(gender)
        size = self.codes.shape[1]
        z = np.zeros(size) if z is None else finite("z_theta", z, size)
        shape = finite("shape", shape, SHAPES)
        return WornDisplacement(self.network, shape, GENDERS.index(gender), z)
