import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.models.smplicit.fit_images import FitImage
from drapeline.models.smplicit.fit_pictures import fit_picture
from drapeline.models.smplicit.model import Meshing, SmplicitModel
from drapeline.models.smplicit.pictures import CLASSES, Person, Picture
from smplicit_toys import skirt_pixels, toy_camera
from smplicit_trainings import train_toy

QUICK = FitImage(points=4000, rays=40, starts=3, rounds=2, steps=2)


@pytest.fixture
def skirt():
    return skirt_pixels()


@pytest.fixture(scope="module")
def model(tmp_path_factory, fields, toy_body):
    return SmplicitModel(train_toy(tmp_path_factory.mktemp("model"), fields, toy_body))


@pytest.mark.portable
def test_every_person_gets_the_garments_that_the_picture_shows(model, skirt, toy_body):
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
    first, second = fit_picture(picture, {"skirt": model}, QUICK, Meshing(0.04, 0.028), 0)
    assert list(first) == ["skirt"]
    assert second == {}
    posed, _ = posed_vertices(toy_body, np.zeros(10), REST_POSE[None])
    if len(first["skirt"].posed.faces):
        assert np.abs(first["skirt"].posed.vertices).max() < np.abs(posed).max() + 1


def test_missing_models_are_named(model, skirt):
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
        fit_picture(picture, {"skirt": model}, QUICK, Meshing(0.04, 0.028), 0)
