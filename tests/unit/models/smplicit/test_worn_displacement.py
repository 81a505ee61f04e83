import numpy as np
import torch

from drapeline.bodies.rest_skinning import tpose_motions
from drapeline.frames import REST_POSE
from drapeline.learning_data.pose_displacements import encode_poses
from drapeline.models.smplicit.displacement_network import blend_motions, encode_turns
from drapeline.models.smplicit.repose import garment_weights
from drapeline.models.smplicit.worn_displacement import WornDisplacement
from drapeline.seeding import rng_for
from toys.displacement_trainings import toy_displacement
from toys.smplicit import tube

SHAPE = 0.5 * rng_for(0, "shape").normal(size=10)
POSES = REST_POSE + 0.3 * rng_for(0, "poses").normal(size=(3, 72))


def test_the_network_is_given_what_is_known(displacements, toy_body):
    """Frames one by one give what they give together, here in one batch."""
    network, mesh = toy_displacement(displacements, toy_body), tube(0.3, -0.5, 0.0)
    weights, motions = garment_weights(mesh, toy_body, SHAPE), tpose_motions(toy_body, SHAPE, POSES)
    z = np.array([0.1, -0.2, 0.3])
    found = WornDisplacement(network, SHAPE, 1, z).displace(mesh.vertices, weights, POSES, motions)
    joints = torch.from_numpy(motions).float()
    shares = torch.from_numpy(weights).float().expand(3, -1, -1)
    with torch.no_grad():
        expected = network(
            torch.from_numpy(mesh.vertices).expand(3, -1, -1),
            encode_turns(blend_motions(shares, joints), joints),
            torch.from_numpy(encode_poses(POSES)),
            torch.tensor(SHAPE, dtype=torch.float32).expand(3, -1),
            torch.tensor([1, 1, 1]),
            torch.tensor(z, dtype=torch.float32).expand(3, -1),
        )
    np.testing.assert_allclose(found, expected, atol=1e-6)
    assert np.ptp(found, axis=0).max() > 1e-6


def test_no_frames_are_no_displacements(displacements, toy_body):
    network, mesh = toy_displacement(displacements, toy_body), tube(0.3, -0.5, 0.0)
    weights = garment_weights(mesh, toy_body, SHAPE)
    worn = WornDisplacement(network, SHAPE, 0, np.zeros(3))
    found = worn.displace(mesh.vertices, weights, POSES[:0], np.zeros((0, 24, 3, 4)))
    assert found.shape == (0, len(mesh.vertices), 3)
