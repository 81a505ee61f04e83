import numpy as np
import pytest

from drapeline.geometry.mesh import Mesh
from drapeline.models.pictures.dressed import posed_person, seen_parts
from drapeline.models.smplicit.dressing import BodyShape
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.pictures import drape
from drapeline.models.smplicit.pictures.drape import (
    best_silhouette,
    drape_candidates,
    drape_picture,
)
from drapeline.models.smplicit.pictures.garments import decode_nearest, fit_picture, observe
from drapeline.outfits.worn import DrapedSheet
from toys.gallery import TubeField
from toys.smplicit import MESHING, QUICK, street, toy_camera

UP = np.array([0, 0, 0.1], np.float32)


class Lift:
    """Hangs sheets higher than where they are at rest, by 10 cm; some times, as they are counted.

    Args:
        times: when it does not fail.
        high: when it is by a metre instead.
    """

    def __init__(self, times, high=()):
        self.times, self.high, self.ups = times, high, []

    def __call__(self, sheets, body, gender, shape, pose, trans, up):
        self.ups.append(up)
        count = len(self.ups)
        if count not in self.times:
            return {}
        rise = UP * (10 if count in self.high else 1)
        return {
            name: DrapedSheet(sheet, Mesh(sheet.vertices + rise, sheet.faces))
            for name, sheet in sheets.items()
        }


@pytest.fixture
def found(fitting_model, skirt, monkeypatch):
    """A picture, what was found in it, the training garments beside that, and how to go on."""
    monkeypatch.setattr(SmplicitModel, "field", lambda self, z, *, gender, shape: TubeField(z))
    models, picture = {"skirt": fitting_model}, street(skirt, ("skirt",))
    (outfit,) = fit_picture(picture, models, QUICK, MESHING, 0)
    body = posed_person(picture.people[0], fitting_model.bodies)
    observed = {"skirt": observe(picture, 0, "skirt", fitting_model, body)}
    wearer = BodyShape("male", np.zeros(10))
    return picture, outfit, decode_nearest(observed, wearer, QUICK, MESHING, 0), observed


def moved(outfit, by):
    return {
        name: one._replace(posed=Mesh(one.posed.vertices + np.float32(by), one.posed.faces))
        for name, one in outfit.items()
    }


@pytest.mark.portable
@pytest.mark.parametrize(
    ("times", "ways"),
    [
        ([], ["fitted"]),
        ([1], ["nearest"]),
        ([2], ["fitted"]),
        ([2, 3], ["again", "fitted"]),
        ([1, 2, 3], ["nearest", "again", "fitted"]),
    ],
)
def test_garments_hang_and_are_fitted_anew(found, monkeypatch, times, ways):
    picture, outfit, nearest, observed = found
    fitted, bodies = drape.fit_codes_to_views, []

    def watched(model, codes, views, *others):
        bodies.extend(len(view.body.rest) for view in views)
        return fitted(model, codes, views, *others)

    monkeypatch.setattr(drape, "fit_codes_to_views", watched)
    draper = Lift(times)
    draped = drape_candidates(
        picture.people[0], outfit, nearest, observed, QUICK, MESHING, 0, draper
    )
    assert list(draped) == ways
    # The camera's picture is upright.
    np.testing.assert_allclose(draper.ups[0], -toy_camera().axes[1])
    assert len(draper.ups) == (3 if 2 in times else 2)
    if 2 not in times:
        assert bodies == []
        taken = (outfit if not times else nearest)["skirt"]
        assert (draped[ways[0]]["skirt"].z == taken.z).all()
        assert (draped[ways[0]]["skirt"].posed is outfit["skirt"].posed) == (not times)
        return
    own = observed["skirt"].view.body.rest
    assert bodies == [len(own) + len(outfit["skirt"].sheet.vertices)]
    for way in draped.values():
        rise = way["skirt"].posed.vertices - way["skirt"].sheet.vertices
        assert rise == pytest.approx(np.tile(UP, (len(rise), 1)), abs=1e-6)
    if "again" in ways:
        assert (draped["again"]["skirt"].z != outfit["skirt"].z).any()


@pytest.mark.portable
def test_the_outfit_is_taken_that_looks_most_like_the_picture(found):
    _, outfit, _, observed = found
    parts = seen_parts(observed["skirt"].view.body, [outfit["skirt"].posed], toy_camera())
    view = observed["skirt"].view._replace(shown=parts == 2)
    observed = {"skirt": observed["skirt"]._replace(view=view)}
    near, far = moved(outfit, [0.03, 0, 0]), moved(outfit, [0, 0, 0.3])
    assert best_silhouette({"far": far, "near": near}, observed) is near
    assert best_silhouette({"near": near, "far": far, "same": outfit}, observed) is outfit
    # Where nothing is known of it, it does not count.
    unsure = np.ones_like(view.shown)
    rows = np.flatnonzero(view.shown.any(axis=1))
    unsure[rows[: len(rows) // 3]] = False
    beneath = moved(outfit, [0, 0, -0.3])
    observed = {"skirt": observed["skirt"]._replace(view=view._replace(unsure=unsure))}
    assert best_silhouette({"beneath": beneath, "far": far}, observed) is far


@pytest.mark.portable
def test_whole_pictures_get_what_is_most_like_them(found, fitting_model):
    picture, outfit, *_ = found
    how = {"skirt": fitting_model}, QUICK, MESHING, 0
    # What is a metre too high is not in the picture.
    for high in ([1, 2], [1, 3], [2, 3]):
        (draped,) = drape_picture(picture, [outfit], *how, Lift([1, 2, 3], high))
        rise = draped["skirt"].posed.vertices - draped["skirt"].sheet.vertices
        assert rise == pytest.approx(np.tile(UP, (len(rise), 1)), abs=1e-6)
    (skinned,) = drape_picture(picture, [outfit], *how, Lift([]))
    assert skinned["skirt"] is outfit["skirt"]


def test_a_person_without_garments_stays_without(fitting_model, skirt):
    how, draper = ({"skirt": fitting_model}, QUICK, MESHING, 0), Lift([1])
    picture = street(skirt, ())
    people = fit_picture(picture, *how)
    assert drape_picture(picture, people, *how, draper) == people == [{}]
    assert not draper.ups
