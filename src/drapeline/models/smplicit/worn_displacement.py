"""What a network of displacements does to a garment on one wearer."""

import numpy as np
import torch

from drapeline.learning_data.pose_displacements import encode_poses
from drapeline.models.smplicit.displacement_network import DisplacementField


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
