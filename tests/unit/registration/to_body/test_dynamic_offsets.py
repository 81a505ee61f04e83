"""Offsets of garments in motion, there and back in both versions."""

import numpy as np
import pytest

from drapeline.bodies.kinematics import skin_points
from drapeline.bodies.model import posed_vertices
from drapeline.bodies.rest_body import rest_body, rest_to_pose
from drapeline.bodies.weight_transfer import nearest_weights
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import vertex_normals
from drapeline.registration.to_body.dynamic_offsets import (
    SampleGarment,
    dynamic_offsets,
    load_sample_garment,
    points_from_offsets,
)

SHAPE = np.linspace(-1, 1, 10)


@pytest.fixture(scope="module")
def poses():
    return REST_POSE + np.random.default_rng(0).normal(0, 0.4, (5, 72))


@pytest.fixture(scope="module")
def garment(toy_body):
    """A shell two centimetres outside of the torso and thighs."""
    rest = rest_body(toy_body, SHAPE)
    mask = (np.abs(rest[:, 2] + 0.05) < 0.3) & (np.abs(rest[:, 0]) < 0.3)
    vertex = np.flatnonzero(mask).astype(np.int32)
    shell = rest + 0.02 * vertex_normals(rest, toy_body.faces)
    faces = toy_body.faces[mask[toy_body.faces].all(1)]
    weights = nearest_weights(shell, faces, rest, toy_body.faces, toy_body.weights)
    offsets = np.where(mask[:, None], shell - rest, 0).astype(np.float32)
    return SampleGarment(
        mask,
        vertex,
        np.repeat(vertex[:, None], 3, 1),
        np.tile(np.array([1, 0, 0], np.float32), (len(vertex), 1)),
        offsets,
        weights[vertex],
    )


@pytest.mark.parametrize("version", ["posed", "unposed"])
def test_offsets_there_and_back(toy_body, garment, poses, version):
    rng = np.random.default_rng(2)
    count = len(toy_body.v_template)
    cloth = posed_vertices(toy_body, SHAPE, poses)[0] + rng.normal(0, 0.02, (5, count, 3))
    cloth = cloth.astype(np.float32)
    offsets = dynamic_offsets(garment, cloth, toy_body, SHAPE, poses, version)
    assert offsets.shape == (5, count, 3)
    assert not offsets[:, ~garment.mask].any()
    found = points_from_offsets(garment, offsets, toy_body, SHAPE, poses, version)
    np.testing.assert_allclose(found, cloth[:, garment.vertex], atol=1e-5)


def test_cloth_that_follows_the_body_has_no_unposed_offsets(toy_body, garment, poses):
    rest = (rest_body(toy_body, SHAPE) + garment.offsets)[garment.vertex]
    cloth = np.zeros((5, len(toy_body.v_template), 3), np.float32)
    cloth[:, garment.vertex] = skin_points(
        rest, rest_to_pose(toy_body, SHAPE, poses), garment.weights
    )
    unposed = dynamic_offsets(garment, cloth, toy_body, SHAPE, poses, "unposed")
    assert np.abs(unposed).max() < 1e-5
    turned = poses.copy()
    turned[:, :3] = REST_POSE[:3]
    assert np.abs(dynamic_offsets(garment, cloth, toy_body, SHAPE, turned, "unposed")).max() > 0.01


def test_in_rest_the_posed_offsets_are_the_static_ones(toy_body, garment):
    rest = (rest_body(toy_body, SHAPE) + garment.offsets).astype(np.float32)
    found = dynamic_offsets(garment, rest[None], toy_body, SHAPE, REST_POSE[None], "posed")
    np.testing.assert_allclose(found[0], garment.offsets, atol=1e-5)


def test_a_saved_garment_comes_back(garment, tmp_path):
    garment.save(tmp_path / "Top.npz")
    again = load_sample_garment(tmp_path / "Top.npz")
    for name, value in vars(garment).items():
        np.testing.assert_array_equal(getattr(again, name), value)
