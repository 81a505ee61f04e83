from types import SimpleNamespace

import numpy as np
import pytest

from drapeline.bodies.moved_body import BodyState
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.models.pictures.dressed import FittedGarment
from drapeline.models.smplicit.scans import garments
from drapeline.models.smplicit.scans.fit import FittedScan, ScanFits
from drapeline.models.smplicit.scans.garments import drape_scan
from drapeline.models.smplicit.settings import FitScan
from drapeline.outfits.worn import DrapedSheet

SQUARE = Mesh(np.zeros((4, 3), np.float32), np.int32([[0, 1, 2], [0, 2, 3]]))
TWO_PIECES = Mesh(np.zeros((6, 3), np.float32), np.int32([[0, 1, 2], [3, 4, 5]]))
STATE = BodyState.of(REST_POSE, np.array([1.0, 2.0, 3.0]), np.arange(10.0))
SCAN = SimpleNamespace(gender="male")
MODELS = {"skirt": SimpleNamespace(bodies={"male": "body"})}


def garment(z, sheet=SQUARE):
    return FittedGarment(np.array([z]), sheet, sheet)


class Lift:
    """Drapes sheets as much higher as it has draped others before, a number of times."""

    def __init__(self, times):
        self.times, self.wearers = times, []

    def __call__(self, sheets, *wearer):
        self.wearers.append(wearer)
        rise = np.float32(len(self.wearers))
        if rise > self.times:
            return {}
        return {
            name: DrapedSheet(s, Mesh(s.vertices + rise, s.faces)) for name, s in sheets.items()
        }


@pytest.fixture
def drape_skirt(monkeypatch):
    """drape_skirt(draper, sheet, fitted) -> the skirt as it hangs, whose code is 1 and becomes 2.

    The training code that fits best is 0.
    """
    found = FittedScan({"Skirt": np.array([1.0])}, STATE)
    nearest = FittedScan({"Skirt": np.array([0.0])}, STATE._replace(trans=STATE.trans + 1))

    def run(draper, sheet=SQUARE, fitted=SQUARE):
        def again(scan, models, given, draped, *how):
            assert (scan, models, given.body) == (SCAN, MODELS, STATE)
            assert given.codes["Skirt"] == (fitted is SQUARE)
            assert (draped["Skirt"].posed.vertices == 1).all()
            assert len(draped["Skirt"].posed.faces) == 2
            return {"Skirt": np.array([2.0])}

        def decode(scan, models, codes, body, meshing):
            (z,) = codes["Skirt"]
            assert body == STATE
            return None, {"Skirt": garment(z, sheet if z == 2 else SQUARE)}

        monkeypatch.setattr(garments, "fit_to_cloth", again)
        monkeypatch.setattr(garments, "decode_in_scan", decode)
        worn = {"Skirt": garment(1.0, fitted)}
        fits = ScanFits(nearest, found, found)
        return drape_scan(SCAN, MODELS, fits, worn, FitScan(), None, 0, draper)["Skirt"]

    return run


@pytest.mark.parametrize(("times", "z", "rise"), [(0, 1, 0), (1, 1, 1), (2, 2, 2)])
def test_garments_hang_are_fitted_and_hang_once_more(drape_skirt, times, z, rise):
    """As far as they can be draped."""
    draper = Lift(times)
    skirt = drape_skirt(draper)
    assert skirt.z == z
    assert (skirt.posed.vertices == rise).all()
    body, gender, shape, pose, trans, up = draper.wearers[0]
    assert (body, gender) == ("body", "male")
    np.testing.assert_array_equal(shape, STATE.shape)
    np.testing.assert_allclose(pose, STATE.pose)
    np.testing.assert_array_equal(trans, STATE.trans)
    np.testing.assert_array_equal(up, [0, 0, 1])
    assert len(draper.wearers) == min(times + 1, 2)


def test_a_code_of_another_kind_of_garment_is_not_taken(drape_skirt):
    skirt = drape_skirt(Lift(2), TWO_PIECES)
    assert skirt.z == 0
    assert (skirt.posed.vertices == 2).all()
    torn = Mesh(TWO_PIECES.vertices, np.int32([[0, 1, 2], [3, 4, 5], [0, 2, 1]]))
    assert drape_skirt(Lift(1), fitted=torn).z == 0
