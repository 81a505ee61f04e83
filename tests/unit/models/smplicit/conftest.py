import pytest

from drapeline.models.smplicit.model import SmplicitModel
from toys.bodies import toy_body as make_toy_body
from toys.smplicit import skirt_pixels, toy_fields
from toys.smplicit_trainings import train_toy


@pytest.fixture(scope="session")
def fields(tmp_path_factory):
    """Fields of the toy skirts."""
    return toy_fields(tmp_path_factory.mktemp("fields"), make_toy_body)


@pytest.fixture(scope="session")
def fitting_model(tmp_path_factory, fields, toy_body):
    """A model of the toy skirts that finds them in pictures."""
    return SmplicitModel(train_toy(tmp_path_factory.mktemp("fitting"), fields, toy_body))


@pytest.fixture
def skirt():
    """(H, W) bool, its pixels in the picture of `toy_camera`."""
    return skirt_pixels()
