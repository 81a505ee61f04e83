import copy

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.models.smplicit.fit_images import FitImage
from drapeline.models.smplicit.fit_pictures import codes_of_class, fit_picture
from drapeline.models.smplicit.model import Meshing, SmplicitModel
from drapeline.models.smplicit.pictures import CLASSES, Person, Picture
from drapeline.outfits.garment_types import GARMENTS
from gallery_toys import TubeField
from smplicit_toys import toy_camera

QUICK = FitImage(points=4000, rays=40, starts=3, rounds=2, steps=2)


@pytest.mark.portable
def test_every_person_gets_the_garments_that_the_picture_shows(fitting_model, skirt, monkeypatch):
    monkeypatch.setattr(SmplicitModel, "field", lambda self, z, *, gender, shape: TubeField(z))
    classes = np.where(skirt, CLASSES.index("skirt"), 0).astype(np.uint8)
    everywhere = np.ones_like(skirt)

    def person(garments):
        return Person(
            "male",
            np.zeros(10),
            REST_POSE.copy(),
            np.zeros(3),
            toy_camera(),
            everywhere,
            ~everywhere,
            garments,
        )

    picture = Picture("street", classes, None, (person(("skirt",)), person(())))
    first, second = fit_picture(picture, {"skirt": fitting_model}, QUICK, Meshing(0.04, 0.028), 0)
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
    everywhere = np.ones_like(skirt)
    one = Person(
        "male",
        np.zeros(10),
        REST_POSE.copy(),
        np.zeros(3),
        toy_camera(),
        everywhere,
        ~everywhere,
        ("upper",),
    )
    picture = Picture("street", np.zeros(skirt.shape, np.uint8), None, (one,))
    with pytest.raises(InputError, match="street: shows garments of the model upper"):
        fit_picture(picture, {"skirt": fitting_model}, QUICK, Meshing(0.04, 0.028), 0)
