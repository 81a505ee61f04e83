"""True garments moved by the paper's skinning."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.bodies.kinematics import skin_points
from drapeline.bodies.rest_body import rest_body, rest_to_pose
from drapeline.bodies.weight_transfer import interpolated_weights
from drapeline.models.garment4d.data import BodySet
from drapeline.models.garment4d.scans import INTERPOLATED, InterpolatedMover
from drapeline.models.garment4d.settings import SkinningSettings
from toys.people import bent_person, standing_person, turned_person

SETTINGS = SkinningSettings(neighbours=16, passes=5)


@pytest.fixture(scope="module")
def move(toy_body):
    mover = InterpolatedMover(BodySet({"female": toy_body, "male": toy_body}, 30), SETTINGS)

    def moved(person):
        found = mover.move(person)
        assert found.keys() == {INTERPOLATED} == mover.watch.seconds.keys()
        return found[INTERPOLATED]

    return moved


def test_a_garment_in_the_rest_pose_stays_where_it_is(move):
    person = standing_person()
    for name, mesh in move(person).items():
        np.testing.assert_array_equal(mesh.faces, person.rest[name].faces)
        np.testing.assert_allclose(mesh.vertices, person.rest[name].vertices, atol=1e-5)


def test_a_turn_of_the_root_turns_the_garment(move):
    turn = Rotation.from_euler("zy", [70, 20], degrees=True)
    person = turned_person(turn)
    found = move(person)
    assert found.keys() == person.rest.keys()
    for name, mesh in found.items():
        turned = turn.apply(person.rest[name].vertices)
        np.testing.assert_allclose(mesh.vertices, turned, atol=1e-5)


def test_a_bent_body_takes_the_garment_along_by_smoothed_weights(move, toy_body):
    person = bent_person()
    motions = rest_to_pose(toy_body, person.shape, person.poses[-1:])
    for name, mesh in move(person).items():
        rest = person.rest[name]
        skin = rest_body(toy_body, person.shape)
        weights = interpolated_weights(rest.vertices, rest.faces, skin, toy_body.weights, 16, 5)
        (expected,) = skin_points(rest.vertices, motions, weights)
        np.testing.assert_allclose(mesh.vertices, expected, atol=1e-4)
