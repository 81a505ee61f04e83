import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.models.smplicit.fit_images import FitImage
from drapeline.models.smplicit.fit_pictures import fit_picture
from drapeline.models.smplicit.model import Meshing, SmplicitModel
from drapeline.models.smplicit.pictures import CLASSES, Person, Picture
from drapeline.rendering.camera import Camera
from smplicit_trainings import train_toy

SIZE = 120
QUICK = FitImage(points=4000, rays=40, starts=3, rounds=2, steps=2)
WEARER = {"gender": "female", "shape": [0.0] * 10, "pose": REST_POSE.tolist()}


def camera():
    intrinsics = np.array([[150, 0, SIZE / 2], [0, 150, SIZE / 2], [0, 0, 1.0]])
    to_camera = np.eye(4)
    to_camera[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    to_camera[2, 3] = 2.5
    return Camera(intrinsics, to_camera, SIZE, SIZE)


@pytest.fixture(scope="module")
def model(tmp_path_factory, fields, toy_body):
    return SmplicitModel(train_toy(tmp_path_factory.mktemp("model"), fields, toy_body))


@pytest.fixture(scope="module")
def skirt():
    """Pixels of a skirt's silhouette."""
    shown = np.zeros((SIZE, SIZE), dtype=bool)
    shown[60:85, 40:80] = True
    return shown


@pytest.mark.portable
def test_a_garment_is_fitted_and_worn(model, skirt, toy_body):
    found = model.fit_image(skirt, camera(), **WEARER, trans=[0.0, 0.0, 0.0])
    assert found.z.shape == (5,)
    assert np.isfinite(found.z).all()
    assert found.posed.faces.shape == found.sheet.faces.shape
    again = model.fit_image(skirt, camera(), **WEARER, trans=[0.0, 0.0, 0.0])
    np.testing.assert_array_equal(found.z, again.z)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"shown": np.ones((5, 7), bool)}, "the image has 7 x 5 pixels, expected 120 x 120"),
        ({"shown": np.zeros((SIZE, SIZE), bool)}, "no pixel shows it"),
        ({"trans": [50.0, 0, 0]}, "do body and camera belong to the picture"),
        ({"pose": [0.0] * 3}, "pose: .* expected 72 finite numbers"),
        ({"gender": "other"}, "gender: 'other', expected one of female, male"),
    ],
)
def test_wrong_arguments_are_named(model, skirt, changes, message):
    arguments = {"shown": skirt, "camera": camera(), **WEARER, "trans": [0.0] * 3, **changes}
    with pytest.raises(InputError, match=message):
        model.fit_image(**arguments)


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
            camera(),
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
        camera(),
        everywhere,
        ~everywhere,
        ("upper",),
    )
    picture = Picture("street", np.zeros(skirt.shape, np.uint8), None, (one,))
    with pytest.raises(InputError, match="street: shows garments of the model upper"):
        fit_picture(picture, {"skirt": model}, QUICK, Meshing(0.04, 0.028), 0)
