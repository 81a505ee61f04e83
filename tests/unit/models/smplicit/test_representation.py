import numpy as np

from drapeline.geometry.mesh import Mesh
from drapeline.models.contract import HeldOutGarment
from drapeline.models.smplicit.representation import FieldCode, HeldOut, save_held_out
from drapeline.outfits.garment_types import GARMENTS
from toys.smplicit import tube

NONE = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))


def test_codes_and_surfaces_are_those_of_the_files(tmp_path):
    sheets = {"Top": tube(0.3, -0.5, 0.0), "Skirt": tube(0.3, -0.5, 0.0, around=12)}
    for number, (garment, sheet) in enumerate(sheets.items(), 1):
        held_out = HeldOut(
            np.array([f"s{number}"]),
            np.array([GARMENTS.index(garment)], np.int8),
            np.zeros((1, 2 + number), np.float32),
            [sheet],
        )
        save_held_out(tmp_path / f"{garment}.npz", held_out)
    code = FieldCode([tmp_path / "Top.npz", tmp_path / "Skirt.npz"])
    asked = [HeldOutGarment(0, "s2", "Skirt", NONE), HeldOutGarment(1, "s1", "Top", NONE)]
    found = [len(mesh.faces) for mesh in code.rebuild(asked)]
    assert found == [len(sheets["Skirt"].faces), len(sheets["Top"].faces)]
    assert code.code_numbers("Top") == 3
    assert code.code_numbers("Skirt") == 4
    assert code.code_numbers("Dress") is None
