import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.outfits.worn import HungSheet
from toys.gallery import TubeField
from toys.smplicit import PICTURE_PX, toy_camera

WEARER = {"gender": "female", "shape": [0.0] * 10, "pose": REST_POSE.tolist()}


@pytest.mark.portable
def test_a_garment_is_fitted_and_worn(fitting_model, skirt, toy_body):
    found = fitting_model.fit_image(skirt, toy_camera(), **WEARER, trans=[0.0, 0.0, 0.0])
    assert found.z.shape == (5,)
    assert np.isfinite(found.z).all()
    assert found.posed.faces.shape == found.sheet.faces.shape
    again = fitting_model.fit_image(skirt, toy_camera(), **WEARER, trans=[0.0, 0.0, 0.0])
    np.testing.assert_array_equal(found.z, again.z)


@pytest.mark.portable
def test_the_garment_of_a_picture_hangs_if_it_can_be_hung(fitting_model, skirt, monkeypatch):
    monkeypatch.setattr(SmplicitModel, "field", lambda self, z, *, gender, shape: TubeField(z))
    ups, risen = [], np.array([0.0, 0.0, 0.1])

    def lift(sheets, body, gender, shape, pose, trans, up):
        ups.append(up)
        return {n: HungSheet(s, Mesh(s.vertices + risen, s.faces)) for n, s in sheets.items()}

    place = {**WEARER, "trans": [0.0] * 3}
    skinned = fitting_model.fit_image(skirt, toy_camera(), **place)
    hung = fitting_model.fit_image(skirt, toy_camera(), **place, hang=lift)
    np.testing.assert_allclose(ups, np.tile(-toy_camera().axes[1], (3, 1)))
    rise = hung.posed.vertices - hung.sheet.vertices
    np.testing.assert_allclose(rise, np.tile(risen, (len(rise), 1)), atol=1e-6)
    unable = fitting_model.fit_image(skirt, toy_camera(), **place, hang=lambda *wearer: {})
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
        fitting_model.fit_image(**arguments)


def standing(toy_body):
    """Points of a standing body, whose hips are a skirt, with their labels."""
    points, _ = posed_vertices(toy_body, np.zeros(10), REST_POSE[None], PLACE[None])
    height = points[0, :, 2] - PLACE[2]
    return points[0], ((height < 0.1) & (height > -0.4)).astype(np.int64)


PLACE = np.array([0.1, 0.0, 0.9])
ESTIMATE = {"gender": "female", "pose": REST_POSE, "trans": PLACE}


@pytest.mark.portable
def test_a_scan_gives_the_garment_and_the_body_under_it(fitting_model, toy_body):
    found = fitting_model.fit_points(*standing(toy_body), **ESTIMATE)
    assert found.garment.z.shape == (fitting_model.latent,)
    assert len(found.garment.sheet.vertices) == len(found.moved.vertices)
    assert found.pose.shape == (72,)
    np.testing.assert_allclose(found.trans, PLACE, atol=0.03)


@pytest.mark.portable
def test_the_garment_of_a_scan_hangs_if_it_can_be_hung(fitting_model, toy_body, monkeypatch):
    monkeypatch.setattr(SmplicitModel, "field", lambda self, z, *, gender, shape: TubeField(z))

    def lift(sheets, *wearer):
        return {n: HungSheet(s, Mesh(s.vertices + PLACE, s.faces)) for n, s in sheets.items()}

    garment = fitting_model.fit_points(*standing(toy_body), **ESTIMATE, hang=lift).garment
    assert len(garment.sheet.vertices)
    np.testing.assert_allclose(garment.posed.vertices, garment.sheet.vertices + PLACE, atol=1e-5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda points, labels: (1000 * points, labels), r"millimetres\?"),
        (lambda points, labels: (points[:0], labels[:0]), "no points, expected at least one"),
        (lambda points, labels: (points, labels[:-1]), "labels have shape"),
        (lambda points, labels: (points, labels + 1), "has the label 2, expected 0 for skin"),
        (lambda points, labels: (points, 0 * labels), "no point is labelled as Skirt"),
        (lambda points, labels: (points + 1.0, labels), "m or more from the body"),
    ],
)
def test_scans_that_cannot_be_are_refused(fitting_model, toy_body, change, message):
    with pytest.raises(InputError, match=message):
        fitting_model.fit_points(*change(*standing(toy_body)), **ESTIMATE)


def test_estimates_that_cannot_be_are_refused(fitting_model, toy_body):
    points, labels = standing(toy_body)
    for change, message in (
        ({"gender": "tall"}, "gender: 'tall'"),
        ({"pose": np.zeros(3)}, "pose: shape"),
        ({"joints": np.zeros((3, 3))}, "joints has shape"),
    ):
        with pytest.raises(InputError, match=message):
            fitting_model.fit_points(points, labels, **{**ESTIMATE, **change})
    with pytest.raises(InputError, match="garments are Kilt"):
        fitting_model.fit_points(points, labels, "Kilt", **ESTIMATE)
