"""What a network of displacements does to a garment on one wearer."""

import numpy as np
import torch

from drapeline.learning_data.pose_displacements import encode_poses
from drapeline.models.smplicit.displacement_network import (
    DisplacementField,
    blend_motions,
    encode_turns,
)


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
        self._gender = torch.tensor([gender], device=network.device)
        self._shape, self._z = self._tensor(shape), self._tensor(z)

    def _tensor(self, values: np.ndarray) -> torch.Tensor:
        """The only one of a batch."""
        return torch.as_tensor(values, dtype=torch.float32, device=self._network.device)[None]

    def displace(
        self, points: np.ndarray, weights: np.ndarray, poses: np.ndarray, motions: np.ndarray
    ) -> np.ndarray:
        """(N, V, 3) float32 metres in the T-pose; see `repose.Displacement`."""
        places, shares = self._tensor(points), self._tensor(weights)
        found = np.zeros((len(motions), len(points), 3), dtype=np.float32)
        with torch.no_grad():
            for frame, pose in enumerate(encode_poses(poses)):
                joints = self._tensor(motions[frame])
                turns = encode_turns(blend_motions(shares, joints), joints)
                wearer = (self._tensor(pose), self._shape, self._gender)
                found[frame] = self._network(places, turns, *wearer, self._z)[0].cpu().numpy()
        return found
