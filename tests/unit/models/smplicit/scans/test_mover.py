"""True garments moved by skinning."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.models.smplicit.gallery.motion import repose
from drapeline.models.smplicit.scans.evaluate import SkinningMover
from toys.people import bent_person, standing_person, turned_person

VARIANTS = {"moved_nearest": "nearest", "moved_smoothed": "smoothed"}


@pytest.fixture(scope="module")
def mover(toy_body):
    return SkinningMover({"female": toy_body, "male": toy_body})


def test_a_garment_in_the_rest_pose_stays_where_it_is(mover):
    person = standing_person()
    found = mover.move(person)
    assert found.keys() == VARIANTS.keys() == mover.watch.seconds.keys()
    for garments in found.values():
        assert garments.keys() == person.rest.keys()
        for name, mesh in garments.items():
            np.testing.assert_array_equal(mesh.faces, person.rest[name].faces)
            np.testing.assert_allclose(mesh.vertices, person.rest[name].vertices, atol=1e-5)


def test_a_turn_of_the_root_turns_the_garment(mover):
    turn = Rotation.from_euler("zy", [70, 20], degrees=True)
    person = turned_person(turn)
    for garments in mover.move(person).values():
        for name, mesh in garments.items():
            turned = turn.apply(person.rest[name].vertices)
            np.testing.assert_allclose(mesh.vertices, turned, atol=1e-5)


def test_only_the_last_frame_counts(mover, toy_body):
    person = bent_person()
    found = mover.move(person)
    alone = mover.move(person._replace(poses=person.poses[-1:], trans=person.trans[-1:]))
    for variant, skinning in VARIANTS.items():
        for name, rest in person.rest.items():
            posed = repose(rest, toy_body, person.shape, person.poses[-1:], skinning=skinning)
            for garments in (found[variant], alone[variant]):
                np.testing.assert_array_equal(garments[name].vertices, posed[0])
