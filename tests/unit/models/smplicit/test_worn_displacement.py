import numpy as np
import torch

from displacement_trainings import toy_displacement
from drapeline.frames import REST_POSE
from drapeline.learning_data.pose_displacements import encode_poses
from drapeline.models.smplicit.worn_displacement import WornDisplacement
from drapeline.seeding import rng_for
from learning import shake_weights

SHAPE = 0.5 * rng_for(0, "shape").normal(size=10)
POSES = REST_POSE + 0.3 * rng_for(0, "poses").normal(size=(3, 72))


def test_frames_are_displaced_as_one_by_one(displacements, toy_body, moving_skirts):
    network = toy_displacement(displacements, toy_body)
    worn = WornDisplacement(network, SHAPE, 1, np.zeros(3))
    points = moving_skirts[0].meshes["Skirt"].vertices
    together = worn.displace(points, POSES)
    assert together.shape == (3, len(points), 3)
    alone = [worn.displace(points, pose[None])[0] for pose in POSES]
    np.testing.assert_array_equal(together, np.stack(alone))
    assert worn.displace(points, POSES[:0]).shape == (0, len(points), 3)


def test_the_network_is_given_what_is_known_of_the_wearer(displacements, toy_body, moving_skirts):
    network = shake_weights(toy_displacement(displacements, toy_body), 0.05)
    points, z = moving_skirts[0].meshes["Skirt"].vertices, np.array([0.1, -0.2, 0.3])
    found = WornDisplacement(network, SHAPE, 1, z).displace(points, POSES)
    with torch.no_grad():
        expected = network(
            torch.from_numpy(points).expand(3, -1, -1),
            torch.tensor(SHAPE, dtype=torch.float32).expand(3, -1),
            torch.tensor([1, 1, 1]),
            torch.from_numpy(encode_poses(POSES)),
            torch.tensor(z, dtype=torch.float32).expand(3, -1),
        )
    np.testing.assert_allclose(found, expected, atol=1e-6)
