import copy

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.models.smplicit import fit_pictures
from drapeline.models.smplicit.fit_images import FitImage
from drapeline.models.smplicit.fit_pictures import codes_of_class, fit_picture, hang_picture
from drapeline.models.smplicit.model import Meshing, SmplicitModel
from drapeline.models.smplicit.pictures import CLASSES, Person, Picture
from drapeline.outfits.garment_types import GARMENTS
from drapeline.outfits.worn import HungSheet
from gallery_toys import TubeField
from smplicit_toys import toy_camera

QUICK = FitImage(points=4000, rays=40, starts=3, rounds=2, steps=2)


MESHING = Meshing(0.04, 0.028)


def street(skirt, *outfits):
    """A picture of people, each in some classes of garments."""
    everywhere = np.ones_like(skirt)
    people = tuple(
        Person(
            "male",
            np.zeros(10),
            REST_POSE.copy(),
            np.zeros(3),
            toy_camera(),
            everywhere,
            ~everywhere,
            garments,
        )
        for garments in outfits
    )
    classes = np.where(skirt, CLASSES.index("skirt"), 0).astype(np.uint8)
    return Picture("street", classes, None, people)


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


class Lift:
    """Hangs sheets 10 cm above where they are at rest, a number of times."""

    def __init__(self, times):
        self.times, self.ups = times, []

    def __call__(self, sheets, body, gender, shape, pose, trans, up):
        self.ups.append(up)
        if len(self.ups) > self.times:
            return {}
        lifted = np.array([0, 0, 0.1], np.float32)
        return {
            name: HungSheet(sheet, Mesh(sheet.vertices + lifted, sheet.faces))
            for name, sheet in sheets.items()
        }


@pytest.mark.portable
@pytest.mark.parametrize("times", [0, 1, 2])
def test_garments_hang_and_are_fitted_anew(fitting_model, skirt, monkeypatch, times):
    monkeypatch.setattr(SmplicitModel, "field", lambda self, z, *, gender, shape: TubeField(z))
    fitted, bodies = fit_pictures.fit_codes_to_views, []

    def watched(model, codes, views, *others):
        bodies.extend(len(view.body.rest) for view in views)
        return fitted(model, codes, views, *others)

    monkeypatch.setattr(fit_pictures, "fit_codes_to_views", watched)
    how = {"skirt": fitting_model}, QUICK, MESHING, 0
    picture, hang = street(skirt, ("skirt",)), Lift(times)
    people = fit_picture(picture, *how)
    (hung,) = hang_picture(picture, people, *how, hang)
    before, after = people[0]["skirt"], hung["skirt"]
    # The camera's picture is upright.
    np.testing.assert_allclose(hang.ups[0], -toy_camera().axes[1])
    assert len(hang.ups) == min(times + 1, 2)
    if times == 0:
        assert after is before
        assert len(bodies) == 1
        return
    assert bodies == [bodies[0], bodies[0] + len(before.sheet.vertices)]
    rise = after.posed.vertices - after.sheet.vertices
    assert rise == pytest.approx(np.tile([0, 0, 0.1], (len(rise), 1)), abs=1e-6)
    assert (after.z == before.z).all() == (times == 1)


def test_a_person_without_garments_stays_without(fitting_model, skirt):
    how, hang = ({"skirt": fitting_model}, QUICK, MESHING, 0), Lift(1)
    picture = street(skirt, ())
    people = fit_picture(picture, *how)
    assert hang_picture(picture, people, *how, hang) == people == [{}]
    assert not hang.ups


@pytest.mark.portable
def test_a_code_of_another_kind_of_garment_is_not_taken(fitting_model, skirt, monkeypatch):
    how = {"skirt": fitting_model}, QUICK, MESHING, 0
    picture = street(skirt, ("skirt",))
    monkeypatch.setattr(SmplicitModel, "field", lambda self, z, *, gender, shape: TubeField(z))
    people = fit_picture(picture, *how)
    whole = people[0]["skirt"].sheet
    torn = Mesh(whole.vertices, whole.faces[len(whole.faces) // 2 + 40 :])
    people[0]["skirt"] = people[0]["skirt"]._replace(sheet=torn)
    hang = Lift(2)
    (hung,) = hang_picture(picture, people, *how, hang)
    assert len(hang.ups) == 1  # there is nothing else to hang
    assert (hung["skirt"].z == people[0]["skirt"].z).all()
    assert len(hung["skirt"].sheet.faces) == len(torn.faces)
