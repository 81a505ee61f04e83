import copy

import numpy as np
import pytest

from drapeline.bodies.follow import PosedBody
from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.models.pictures.dressed import posed_person, seen_parts
from drapeline.models.smplicit.dressing import BodyShape
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.pictures import garments
from drapeline.models.smplicit.pictures.garments import (
    codes_of_class,
    decode_nearest,
    fit_picture,
    observe,
)
from drapeline.outfits.garment_types import GARMENTS
from toys.gallery import TubeField
from toys.smplicit import MESHING, PICTURE_PX, QUICK, street, toy_camera

# Upright, across the camera's way.
SQUARE = Mesh(
    np.float32([[-0.8, 0, -0.8], [0.8, 0, -0.8], [0.8, 0, 0.8], [-0.8, 0, 0.8]]),
    np.int32([[0, 1, 2], [0, 2, 3]]),
)


@pytest.mark.portable
def test_every_person_gets_the_garments_that_the_picture_shows(fitting_model, skirt, monkeypatch):
    monkeypatch.setattr(SmplicitModel, "field", lambda self, z, *, gender, shape: TubeField(z))
    picture = street(skirt, ("skirt",), ())
    first, second = fit_picture(picture, {"skirt": fitting_model}, QUICK, MESHING, 0)
    assert list(first) == ["skirt"]
    assert second == {}
    # At rest it is worn as it is.
    assert len(first["skirt"].sheet.faces)
    assert first["skirt"].posed.vertices == pytest.approx(first["skirt"].sheet.vertices, abs=1e-4)


def test_starts_are_garments_of_the_types_that_a_class_may_be(fitting_model):
    def codes_of(name, types):
        codes = fitting_model.codes._replace(
            z=np.arange(8.0).reshape(4, 2),
            garment=np.array([GARMENTS.index(garment) for garment in types]),
        )
        model = copy.copy(fitting_model)
        model.codes = codes
        return codes_of_class(model, name)[:, 0].tolist()

    whole = ("Dress", "Jumpsuit", "Dress", "Jumpsuit")
    assert codes_of("dress", whole) == [0, 4]
    assert codes_of("jumpsuit", whole) == [2, 6]
    assert codes_of("upper", ("Top", "Tshirt", "Top", "Top")) == [0, 2, 4, 6]


def test_missing_models_are_named(fitting_model, skirt):
    with pytest.raises(InputError, match="street: shows garments of the model upper"):
        fit_picture(street(skirt, ("upper",)), {"skirt": fitting_model}, QUICK, MESHING, 0)


@pytest.mark.portable
def test_the_nearest_garment_is_the_training_garment_with_the_least_loss(
    fitting_model, skirt, monkeypatch
):
    monkeypatch.setattr(SmplicitModel, "field", lambda self, z, *, gender, shape: TubeField(z))
    monkeypatch.setattr(garments, "rank_codes", lambda *_: np.array([3, 0, 2, 1]))
    picture = street(skirt, ("skirt",))
    body = posed_person(picture.people[0], fitting_model.bodies)
    observed = {"skirt": observe(picture, 0, "skirt", fitting_model, body)}
    found = decode_nearest(observed, BodyShape("male", np.zeros(10)), QUICK, MESHING, 0)
    assert (found["skirt"].z == fitting_model.codes.z[3]).all()
    assert len(found["skirt"].posed.faces)


def test_parts_keep_their_numbers_though_nothing_is_left_of_one():
    body = PosedBody(*[SQUARE.vertices] * 2, np.zeros((4, 3, 3)), SQUARE.faces)
    before = Mesh(SQUARE.vertices / 2 - np.float32([0, 0.1, 0]), SQUARE.faces)
    gone = Mesh(np.zeros((0, 3)), np.zeros((0, 3), int))
    parts = seen_parts(body, [gone, before], toy_camera())
    middle = PICTURE_PX // 2
    assert parts[middle, middle] == 3
    assert parts[middle, middle + 45] == 1
    assert parts[0, 0] == 0
