import numpy as np
import pytest

from drapeline.geometry.mesh import Mesh
from drapeline.models.pictures.dressed import FittedGarment, use_draped
from drapeline.models.smplicit.dressing import keep_topology
from drapeline.outfits.worn import DrapedSheet
from toys.gallery import tube_mesh

SKIRT = tube_mesh(np.zeros(3))


def outfit(sheet=SKIRT):
    return {"skirt": FittedGarment(np.zeros(2), sheet, sheet)}


@pytest.mark.parametrize("cut", ["open", "two pieces"])
def test_a_code_of_another_kind_of_garment_is_not_taken(cut):
    middle = SKIRT.vertices[SKIRT.faces].mean(axis=1)
    if cut == "open":  # one opening, from waist to hem
        keep = np.abs(np.arctan2(middle[:, 1], middle[:, 0])) < 2.5
    else:  # as many openings as before
        keep = np.abs(middle[:, 0]) > 0.06
    torn, whole = outfit(Mesh(SKIRT.vertices, SKIRT.faces[keep])), outfit()
    assert keep_topology(torn, whole)["skirt"] is whole["skirt"]
    again = outfit()
    assert keep_topology(again, whole)["skirt"] is again["skirt"]


def test_garments_that_could_not_be_draped_stay_as_they_are():
    both = outfit() | {"upper": outfit()["skirt"]}
    draped = use_draped(both, {"skirt": DrapedSheet(SKIRT, Mesh(SKIRT.vertices + 1, SKIRT.faces))})
    np.testing.assert_array_equal(draped["skirt"].posed.vertices, SKIRT.vertices + 1)
    assert draped["upper"] is both["upper"]
