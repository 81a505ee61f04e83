import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.scans.garments import fit_points
from drapeline.outfits.worn import DrapedSheet
from toys.gallery import TubeField


def standing(toy_body):
    """Points of a standing body, whose hips are a skirt, with their labels."""
    points, _ = posed_vertices(toy_body, np.zeros(10), REST_POSE[None], PLACE[None])
    height = points[0, :, 2] - PLACE[2]
    return points[0], ((height < 0.1) & (height > -0.4)).astype(np.int64)


PLACE = np.array([0.1, 0.0, 0.9])
ESTIMATE = {"gender": "female", "pose": REST_POSE, "trans": PLACE}


@pytest.mark.portable
def test_a_scan_gives_the_garment_and_the_body_under_it(fitting_model, toy_body):
    found = fit_points(fitting_model, *standing(toy_body), **ESTIMATE)
    assert found.garments["Skirt"].z.shape == (fitting_model.latent,)
    assert len(found.garments["Skirt"].sheet.vertices) == len(found.moved["Skirt"].vertices)
    assert found.body.pose.shape == (72,)
    np.testing.assert_allclose(found.body.trans, PLACE, atol=0.03)


@pytest.mark.portable
def test_the_garment_of_a_scan_hangs_if_it_can_be_hung(fitting_model, toy_body, monkeypatch):
    monkeypatch.setattr(SmplicitModel, "field", lambda self, z, *, gender, shape: TubeField(z))

    def lift(sheets, *wearer):
        return {n: DrapedSheet(s, Mesh(s.vertices + PLACE, s.faces)) for n, s in sheets.items()}

    garment = fit_points(fitting_model, *standing(toy_body), **ESTIMATE, draper=lift).garments[
        "Skirt"
    ]
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
        fit_points(fitting_model, *change(*standing(toy_body)), **ESTIMATE)


def test_estimates_that_cannot_be_are_refused(fitting_model, toy_body):
    points, labels = standing(toy_body)
    for change, message in (
        ({"gender": "tall"}, "gender: 'tall'"),
        ({"pose": np.zeros(3)}, "pose: shape"),
        ({"joints": np.zeros((3, 3))}, "joints has shape"),
    ):
        with pytest.raises(InputError, match=message):
            fit_points(fitting_model, points, labels, **{**ESTIMATE, **change})
    with pytest.raises(InputError, match="garments are Kilt"):
        fit_points(fitting_model, points, labels, "Kilt", **ESTIMATE)
