import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.models.smplicit.representation import HeldOut, load_held_out, save_held_out
from drapeline.outfits.garment_types import GARMENTS
from toys.smplicit import tube

NONE = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))


@pytest.fixture
def path(tmp_path):
    names = [GARMENTS.index(name) for name in ("Top", "Tshirt")]
    z = np.arange(6, dtype=np.float32).reshape(2, 3)
    sheets = [tube(0.3, -0.5, 0.0), NONE]
    outfits = np.array(["s1", "s2"])
    save_held_out(tmp_path / "held_out.npz", HeldOut(outfits, np.array(names, np.int8), z, sheets))
    return tmp_path / "held_out.npz"


def test_codes_and_surfaces_are_read_as_written(path):
    found = load_held_out(path)
    assert list(found) == [("s1", "Top"), ("s2", "Tshirt")]
    z, sheet = found["s1", "Top"]
    assert z.tolist() == [0, 1, 2]
    np.testing.assert_array_equal(sheet.vertices, tube(0.3, -0.5, 0.0).vertices)
    assert len(found["s2", "Tshirt"][1].faces) == 0


def test_missing_files_are_named(tmp_path):
    with pytest.raises(InputError, match=r"held_out\.npz: no such file"):
        load_held_out(tmp_path / "held_out.npz")
