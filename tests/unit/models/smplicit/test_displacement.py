import numpy as np
import pytest
import torch

from displacement_toys import CLUSTERS
from displacement_trainings import toy_displacement, train_toy_displacement
from drapeline.bodies.rest_body import rest_body
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.learning_data.pose_displacements import encode_poses
from drapeline.models.load import load
from drapeline.models.smplicit.displacement import (
    PoseDisplacement,
    WornDisplacement,
    load_displacement,
)
from drapeline.models.smplicit.repose import repose
from drapeline.models.training.checkpoints import read_checkpoint
from drapeline.seeding import rng_for
from learning import shake_weights
from smplicit_trainings import train_toy

SHAPE = 0.5 * rng_for(0, "shape").normal(size=10)
POSES = REST_POSE + 0.3 * rng_for(0, "poses").normal(size=(3, 72))


@pytest.fixture(scope="module")
def trained(tmp_path_factory, displacements, toy_body):
    return train_toy_displacement(tmp_path_factory.mktemp("trained"), displacements, toy_body)


def test_the_best_weights_are_loaded(trained):
    model = load(trained)
    assert isinstance(model, PoseDisplacement)
    assert model.name == "skirt"
    state = read_checkpoint(trained / "best.ckpt")["state_dict"]
    for name, value in model.network.state_dict().items():
        assert torch.equal(value, state[name]), name
    assert model.codes.shape == (3, 3)


def test_frames_are_displaced_as_one_by_one(trained, moving_skirts):
    worn = load(trained).worn_by(gender="male", shape=SHAPE)
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


def test_no_code_is_zero(trained, moving_skirts):
    model, points = load(trained), moving_skirts[0].meshes["Skirt"].vertices
    wearer = {"gender": "female", "shape": SHAPE}
    unknown, zero, other = (
        model.worn_by(**wearer, z=z).displace(points, POSES)
        for z in (None, np.zeros(3), np.full(3, 5.0))
    )
    np.testing.assert_array_equal(unknown, zero)
    assert np.abs(other - zero).max() > 1e-6


def test_clusters_are_those_that_it_was_made_with(displacements, toy_body):
    network = toy_displacement(displacements, toy_body)
    at_rest = network.place_basis[:1]  # of female bodies of shape zero
    expected = rest_body(toy_body, np.zeros(10))[CLUSTERS]
    np.testing.assert_allclose(at_rest[0], expected, atol=1e-5)


def test_cloth_is_displaced_before_it_is_skinned(toy_body):
    """A displacement by a centimetre moves rigidly skinned cloth by a centimetre."""

    class Up:
        def displace(self, points, poses):
            return np.tile(np.array([0, 0.01, 0]), (len(poses), len(points), 1))

    skin = Mesh(rest_body(toy_body, SHAPE).astype(np.float32), toy_body.faces)
    turned = np.zeros((2, 72))
    turned[:, 0] = np.pi / 2
    turned[1, 2] = 0.3
    moved, still = (
        repose(skin, toy_body, SHAPE, turned, skinning="smoothed", displacement=given)
        for given in (Up(), None)
    )
    away = moved - still
    np.testing.assert_allclose(np.linalg.norm(away, axis=-1), 0.01, atol=1e-5)
    # The T-pose has Y up, the world Z.
    np.testing.assert_allclose(away[0], np.tile([0, 0, 0.01], (len(skin.vertices), 1)), atol=1e-5)


def test_bad_input_is_refused(trained, tmp_path, fields, toy_body):
    model = PoseDisplacement(trained)
    with pytest.raises(InputError, match="gender: 'child', expected one of"):
        model.worn_by(gender="child", shape=SHAPE)
    with pytest.raises(InputError, match=r"shape: shape \(3,\), expected 10"):
        model.worn_by(gender="male", shape=SHAPE[:3])
    with pytest.raises(InputError, match=r"z_theta: shape \(4,\), expected 3"):
        model.worn_by(gender="male", shape=SHAPE, z=np.zeros(4))
    with pytest.raises(InputError, match=r"best.ckpt: no such file"):
        load_displacement(tmp_path / "nowhere")
    other = train_toy(tmp_path, fields, toy_body, epochs=1)
    with pytest.raises(InputError, match="holds a 'smplicit' network, expected smplicit_displ"):
        load_displacement(other)
