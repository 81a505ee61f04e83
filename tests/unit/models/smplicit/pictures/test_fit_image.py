import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.pictures.drape import fit_image
from drapeline.outfits.worn import DrapedSheet
from toys.gallery import TubeField
from toys.smplicit import PICTURE_PX, toy_camera

WEARER = {"gender": "female", "shape": [0.0] * 10, "pose": REST_POSE.tolist()}


@pytest.mark.portable
def test_a_garment_is_fitted_and_worn(fitting_model, skirt, toy_body):
    found = fit_image(fitting_model, skirt, toy_camera(), **WEARER, trans=[0.0, 0.0, 0.0])
    assert found.z.shape == (5,)
    assert np.isfinite(found.z).all()
    assert found.posed.faces.shape == found.sheet.faces.shape
    again = fit_image(fitting_model, skirt, toy_camera(), **WEARER, trans=[0.0, 0.0, 0.0])
    np.testing.assert_array_equal(found.z, again.z)


@pytest.mark.portable
def test_the_garment_of_a_picture_hangs_if_it_can_be_hung(fitting_model, skirt, monkeypatch):
    monkeypatch.setattr(SmplicitModel, "field", lambda self, z, *, gender, shape: TubeField(z))
    ups, risen = [], np.array([0.0, 0.0, 0.1])

    def lift(sheets, body, gender, shape, pose, trans, up):
        ups.append(up)
        return {n: DrapedSheet(s, Mesh(s.vertices + risen, s.faces)) for n, s in sheets.items()}

    place = {**WEARER, "trans": [0.0] * 3}
    skinned = fit_image(fitting_model, skirt, toy_camera(), **place)
    draped = fit_image(fitting_model, skirt, toy_camera(), **place, draper=lift)
    np.testing.assert_allclose(ups, np.tile(-toy_camera().axes[1], (3, 1)))
    rise = draped.posed.vertices - draped.sheet.vertices
    np.testing.assert_allclose(rise, np.tile(risen, (len(rise), 1)), atol=1e-6)
    unable = fit_image(fitting_model, skirt, toy_camera(), **place, draper=lambda *wearer: {})
    np.testing.assert_array_equal(unable.posed.vertices, skinned.posed.vertices)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"shown": np.ones((5, 7), bool)}, "the image has 7 x 5 pixels, expected 120 x 120"),
        ({"shown": np.zeros((PICTURE_PX, PICTURE_PX), bool)}, "no pixel shows it"),
        ({"trans": [50.0, 0, 0]}, "do body and camera belong to the picture"),
        ({"pose": [0.0] * 3}, "pose: .* expected 72 finite numbers"),
        ({"gender": "other"}, "gender: 'other', expected one of female, male"),
        ({"garment": "Dress"}, "garment: 'Dress', expected one of Skirt"),
    ],
)
def test_wrong_arguments_are_named(fitting_model, skirt, changes, message):
    arguments = {"shown": skirt, "camera": toy_camera(), **WEARER, "trans": [0.0] * 3, **changes}
    with pytest.raises(InputError, match=message):
        fit_image(fitting_model, **arguments)
