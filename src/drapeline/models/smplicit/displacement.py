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

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch

from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import SHAPES
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.learning_data.pose_displacements import DisplacementData, encode_poses
from drapeline.models.smplicit.clusters import BASIS_ROWS, cluster_basis
from drapeline.models.smplicit.displacement_network import DisplacementField
from drapeline.models.smplicit.displacement_settings import DisplacementSettings
from drapeline.models.smplicit.model import check_gender, finite
from drapeline.models.training.checkpoints import read_checkpoint
from drapeline.models.training.module import BEST


class WornDisplacement:
    """The displacement of a garment on one wearer; fulfils `repose.Displacement`.

    Args:
        network: trained or not.
        shape: (10,) of the wearer.
        gender: of the wearer, 0 female, 1 male.
        z: (code,) z_theta of the garment.
    """

    def __init__(
        self, network: DisplacementField, shape: np.ndarray, gender: int, z: np.ndarray
    ) -> None:
        self._network = network
        device = network.device
        self._shape = torch.as_tensor(shape, dtype=torch.float32, device=device)[None]
        self._gender = torch.tensor([gender], device=device)
        self._z = torch.as_tensor(z, dtype=torch.float32, device=device)[None]

    def displace(self, points: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """(N, V, 3) float32 metres in the T-pose, of points (V, 3) at rest for poses (N, 72)."""
        device = self._network.device
        places = torch.as_tensor(points, dtype=torch.float32, device=device)[None]
        found = np.zeros((len(poses), len(points), 3), dtype=np.float32)
        with torch.no_grad():
            for frame, pose in enumerate(torch.from_numpy(encode_poses(poses)).to(device)):
                away = self._network(places, self._shape, self._gender, pose[None], self._z)
                found[frame] = away[0].cpu().numpy()
        return found


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


def load_displacement(folder: str | Path) -> DisplacementField:
    """A trained network, ready to predict.

    Args:
        folder: of the training.

    Raises:
        InputError: the checkpoint is missing, damaged, or of another model.
    """
    path = Path(folder) / BEST
    checkpoint = read_checkpoint(path)
    about = checkpoint["drapeline"]
    if about["checkpoint_type"] != DisplacementField.checkpoint_type:
        raise InputError(
            f"{path}: holds a '{about['checkpoint_type']}' network, expected"
            f" {DisplacementField.checkpoint_type}"
        )
    settings = DisplacementField.parse(about["settings"])
    basis = torch.zeros(BASIS_ROWS, about["clusters"], 3)
    network = DisplacementField(about["name"], settings, basis, about["garments"])
    network.load_state_dict(checkpoint["state_dict"])
    return network.eval().requires_grad_(False)


def new_displacement(
    name: str,
    data: DisplacementData,
    bodies: Mapping[str, BodyModel],
    clusters: np.ndarray,
    settings: DisplacementSettings,
) -> DisplacementField:
    """An untrained network.

    Args:
        name: of `FIELD_MODELS`.
        data: of its garments.
        bodies: by gender.
        clusters: (K,) ids of the bodies' vertices.
        settings: sizes, losses and training.
    """
    return DisplacementField(name, settings, cluster_basis(bodies, clusters), len(data.garment))
