import numpy as np

from drapeline.bodies.follow import PosedBody
from drapeline.geometry.mesh import Mesh
from drapeline.outfits.worn import SkinningOptions, pose_in_layers, stack_layers
from toys.smplicit import tube

CORE = tube(0.15, -0.5, 0.5, around=64, rings=41)
SHIFT = np.array([1.0, 2.0, 3.0])


def shifted():
    turns = np.repeat(np.eye(3)[None], len(CORE.vertices), axis=0)
    rest = CORE.vertices.astype(float)
    return PosedBody(rest, rest + SHIFT, turns, CORE.faces)


def radius(mesh):
    return np.linalg.norm((mesh.vertices - SHIFT)[:, :2], axis=1)


def test_layers_lie_over_one_another_and_over_the_body():
    none = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    rings = {"around": 64, "rings": 21}
    sheets = [tube(0.19, -0.3, 0.3, **rings), none, tube(0.185, -0.1, 0.1, **rings)]
    posed = [Mesh((s.vertices + SHIFT).astype(np.float32), s.faces) for s in sheets]
    inner, nothing, outer = stack_layers(posed, shifted())
    np.testing.assert_allclose(radius(inner), 0.19, atol=1e-4)
    assert len(nothing.faces) == 0
    assert radius(outer).min() > 0.19


def test_what_is_inside_the_body_comes_out():
    sheet = tube(0.145, -0.2, 0.2, around=64, rings=21)
    posed = Mesh((sheet.vertices + SHIFT).astype(np.float32), sheet.faces)
    (worn,) = stack_layers([posed], shifted())
    assert radius(worn).min() > 0.1485


def test_garments_at_rest_are_posed_and_come_back_by_name():
    none = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    sheet = tube(0.2, -0.2, 0.2)
    worn = pose_in_layers({"Skirt": sheet, "Top": none}, shifted(), SkinningOptions())
    np.testing.assert_allclose(worn["Skirt"].vertices, sheet.vertices + SHIFT, atol=1e-5)
    assert len(worn["Top"].faces) == 0
