import numpy as np
import pytest

from drapeline.geometry.mesh import Mesh
from drapeline.models.smplicit import hanging
from drapeline.models.smplicit.fit_pictures import (
    Wearer,
    dress_nearest,
    fit_picture,
    posed_person,
    seek,
)
from drapeline.models.smplicit.hanging import hang_picture, hang_ways, most_like, same_kinds
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.outfits.worn import HungSheet
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
            name: HungSheet(sheet, Mesh(sheet.vertices + rise, sheet.faces))
            for name, sheet in sheets.items()
        }


@pytest.fixture
def found(fitting_model, skirt, monkeypatch):
    """A picture, what was found in it, the training garments beside that, and how to go on."""
    monkeypatch.setattr(SmplicitModel, "field", lambda self, z, *, gender, shape: TubeField(z))
    models, picture = {"skirt": fitting_model}, street(skirt, ("skirt",))
    (outfit,) = fit_picture(picture, models, QUICK, MESHING, 0)
    body = posed_person(picture.people[0], models)
    sought = {"skirt": seek(picture, 0, "skirt", fitting_model, body)}
    wearer = Wearer("male", np.zeros(10))
    return picture, outfit, dress_nearest(sought, wearer, QUICK, MESHING, 0), sought


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
    picture, outfit, nearest, sought = found
    fitted, bodies = hanging.fit_codes_to_views, []

    def watched(model, codes, views, *others):
        bodies.extend(len(view.body.rest) for view in views)
        return fitted(model, codes, views, *others)

    monkeypatch.setattr(hanging, "fit_codes_to_views", watched)
    hang = Lift(times)
    hung = hang_ways(picture.people[0], outfit, nearest, sought, QUICK, MESHING, 0, hang)
    assert list(hung) == ways
    # The camera's picture is upright.
    np.testing.assert_allclose(hang.ups[0], -toy_camera().axes[1])
    assert len(hang.ups) == (3 if 2 in times else 2)
    if 2 not in times:
        assert bodies == []
        taken = (outfit if not times else nearest)["skirt"]
        assert (hung[ways[0]]["skirt"].z == taken.z).all()
        assert (hung[ways[0]]["skirt"].posed is outfit["skirt"].posed) == (not times)
        return
    own = sought["skirt"].view.body.rest
    assert bodies == [len(own) + len(outfit["skirt"].sheet.vertices)]
    for way in hung.values():
        rise = way["skirt"].posed.vertices - way["skirt"].sheet.vertices
        assert rise == pytest.approx(np.tile(UP, (len(rise), 1)), abs=1e-6)
    if "again" in ways:
        assert (hung["again"]["skirt"].z != outfit["skirt"].z).any()


@pytest.mark.portable
def test_the_outfit_is_taken_that_looks_most_like_the_picture(found):
    _, outfit, _, sought = found
    parts = hanging.seen_parts(sought["skirt"].view.body, [outfit["skirt"].posed], toy_camera())
    view = sought["skirt"].view._replace(shown=parts == 2)
    sought = {"skirt": sought["skirt"]._replace(view=view)}
    near, far = moved(outfit, [0.03, 0, 0]), moved(outfit, [0, 0, 0.3])
    assert most_like({"far": far, "near": near}, sought) is near
    assert most_like({"near": near, "far": far, "same": outfit}, sought) is outfit
    # Where nothing is known of it, it does not count.
    unsure = np.ones_like(view.shown)
    rows = np.flatnonzero(view.shown.any(axis=1))
    unsure[rows[: len(rows) // 3]] = False
    beneath = moved(outfit, [0, 0, -0.3])
    sought = {"skirt": sought["skirt"]._replace(view=view._replace(unsure=unsure))}
    assert most_like({"beneath": beneath, "far": far}, sought) is far


@pytest.mark.portable
def test_whole_pictures_get_what_is_most_like_them(found, fitting_model):
    picture, outfit, *_ = found
    how = {"skirt": fitting_model}, QUICK, MESHING, 0
    # What is a metre too high is not in the picture.
    for high in ([1, 2], [1, 3], [2, 3]):
        (hung,) = hang_picture(picture, [outfit], *how, Lift([1, 2, 3], high))
        rise = hung["skirt"].posed.vertices - hung["skirt"].sheet.vertices
        assert rise == pytest.approx(np.tile(UP, (len(rise), 1)), abs=1e-6)
    (skinned,) = hang_picture(picture, [outfit], *how, Lift([]))
    assert skinned["skirt"] is outfit["skirt"]


def test_a_person_without_garments_stays_without(fitting_model, skirt):
    how, hang = ({"skirt": fitting_model}, QUICK, MESHING, 0), Lift([1])
    picture = street(skirt, ())
    people = fit_picture(picture, *how)
    assert hang_picture(picture, people, *how, hang) == people == [{}]
    assert not hang.ups


@pytest.mark.portable
@pytest.mark.parametrize("cut", ["open", "two pieces"])
def test_a_code_of_another_kind_of_garment_is_not_taken(found, cut):
    _, outfit, nearest, _ = found
    whole = outfit["skirt"].sheet
    middle = whole.vertices[whole.faces].mean(axis=1)
    if cut == "open":  # one opening, from waist to hem
        keep = np.abs(np.arctan2(middle[:, 1], middle[:, 0])) < 2.5
    else:  # as many openings as before
        keep = np.abs(middle[:, 0]) > 0.06
    torn = {"skirt": outfit["skirt"]._replace(sheet=Mesh(whole.vertices, whole.faces[keep]))}
    assert same_kinds(torn, nearest)["skirt"] is nearest["skirt"]
    assert same_kinds(outfit, nearest)["skirt"] is outfit["skirt"]
