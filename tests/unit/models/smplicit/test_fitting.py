import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from smplicit_toys import PICTURE_PX, toy_camera

WEARER = {"gender": "female", "shape": [0.0] * 10, "pose": REST_POSE.tolist()}


@pytest.mark.portable
def test_a_garment_is_fitted_and_worn(fitting_model, skirt, toy_body):
    found = fitting_model.fit_image(skirt, toy_camera(), **WEARER, trans=[0.0, 0.0, 0.0])
    assert found.z.shape == (5,)
    assert np.isfinite(found.z).all()
    assert found.posed.faces.shape == found.sheet.faces.shape
    again = fitting_model.fit_image(skirt, toy_camera(), **WEARER, trans=[0.0, 0.0, 0.0])
    np.testing.assert_array_equal(found.z, again.z)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"shown": np.ones((5, 7), bool)}, "the image has 7 x 5 pixels, expected 120 x 120"),
        ({"shown": np.zeros((PICTURE_PX, PICTURE_PX), bool)}, "no pixel shows it"),
        ({"trans": [50.0, 0, 0]}, "do body and camera belong to the picture"),
        ({"pose": [0.0] * 3}, "pose: .* expected 72 finite numbers"),
        ({"gender": "other"}, "gender: 'other', expected one of female, male"),
    ],
)
def test_wrong_arguments_are_named(fitting_model, skirt, changes, message):
    arguments = {"shown": skirt, "camera": toy_camera(), **WEARER, "trans": [0.0] * 3, **changes}
    with pytest.raises(InputError, match=message):
        fitting_model.fit_image(**arguments)
