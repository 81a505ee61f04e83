"""What USD's own library, in the version that Blender brings along, finds in a written file."""

import sys

import numpy as np
import pytest

from drapeline.blender import usd
from drapeline.blender.usd import Usd, UsdGeom, UsdShade, write_usd
from drapeline.dataset.reader import Sample
from drapeline.dataset.sample_meshes import scene_parts
from drapeline.geometry.mesh import vertex_normals
from toys.tiny_sample import write_tiny_sample

FRAMES = 6


@pytest.fixture
def tiny(tmp_path, toy_body):
    return write_tiny_sample(tmp_path, toy_body, frames=FRAMES)


@pytest.fixture
def parts(tiny):
    return scene_parts(Sample(tiny.folder))


@pytest.fixture
def stage(tmp_path, parts, monkeypatch):
    monkeypatch.setattr(usd, "_CHUNK", 4)  # so that there are two of them
    write_usd(tmp_path / "a.usdc", parts)
    return Usd.Stage.Open(str(tmp_path / "a.usdc"))


def test_the_header_tells_axes_unit_and_frame_rate(stage):
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert (stage.GetFramesPerSecond(), stage.GetTimeCodesPerSecond()) == (30, 30)
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, FRAMES - 1)
    assert stage.GetDefaultPrim().GetName() == "sample"


def test_every_frame_has_points_normals_velocities_and_extent(stage, parts):
    for part in parts:
        mesh = UsdGeom.Mesh(stage.GetPrimAtPath(f"/sample/{part.name}"))
        assert mesh.GetNormalsInterpolation() == "vertex"
        world = np.stack(list(part.frames()))
        for attribute in (mesh.GetPointsAttr(), mesh.GetNormalsAttr(), mesh.GetVelocitiesAttr()):
            assert attribute.GetTimeSamples() == list(range(FRAMES))
        for frame, points in enumerate(world):
            np.testing.assert_allclose(mesh.GetPointsAttr().Get(frame), points, atol=1e-6)
            normals = vertex_normals(points, part.mesh.triangles)
            np.testing.assert_allclose(mesh.GetNormalsAttr().Get(frame), normals, atol=1e-4)
            np.testing.assert_allclose(
                mesh.GetExtentAttr().Get(frame), [points.min(axis=0), points.max(axis=0)], atol=1e-6
            )
        np.testing.assert_allclose(
            mesh.GetVelocitiesAttr().Get(3), (world[4] - world[2]) * 15, atol=1e-4
        )


def test_meshes_are_polygons_and_not_subdivided(stage, tiny):
    mesh, rest = UsdGeom.Mesh(stage.GetPrimAtPath("/sample/Skirt")), tiny.meshes["Skirt"]
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
    assert set(mesh.GetFaceVertexCountsAttr().Get()) == {4}
    np.testing.assert_array_equal(mesh.GetFaceVertexIndicesAttr().Get(), rest.faces.ravel())
    uv = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st")
    corners = np.array(uv.ComputeFlattened())
    np.testing.assert_allclose(corners, rest.uv[rest.uv_faces].reshape(-1, 2), atol=1e-6)


def test_colours_are_linear_on_the_mesh_and_in_its_material(stage, parts):
    for part in parts:
        prim = stage.GetPrimAtPath(f"/sample/{part.name}")
        [display] = UsdGeom.Mesh(prim).GetDisplayColorAttr().Get()
        np.testing.assert_allclose(display, part.linear_colour, atol=1e-6)
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        shader, *_ = material.ComputeSurfaceSource()
        diffuse = shader.GetInput("diffuseColor").Get()
        np.testing.assert_allclose(diffuse, part.linear_colour, atol=1e-6)


def test_a_print_lies_beside_the_file_and_in_the_material(tmp_path, toy_body):
    told = {"kind": "breton", "size_m": 0.1, "colours": [[0.8, 0, 0], [1, 1, 1]], "seed": 1}
    folder = write_tiny_sample(tmp_path, toy_body, prints={"Skirt": told}).folder
    (tmp_path / "out").mkdir()
    with Sample(folder) as sample:
        write_usd(tmp_path / "out/a.usdc", scene_parts(sample))
    copy = tmp_path / "out/a_Skirt.png"
    assert {path.name for path in copy.parent.iterdir()} == {"a.usdc", "a_Skirt.png"}
    assert copy.read_bytes() == (folder / "Skirt.png").read_bytes()
    stage = Usd.Stage.Open(str(tmp_path / "out/a.usdc"))
    material, _ = UsdShade.MaterialBindingAPI(
        stage.GetPrimAtPath("/sample/Skirt")
    ).ComputeBoundMaterial()
    shader, *_ = material.ComputeSurfaceSource()
    [source], _ = shader.GetInput("diffuseColor").GetConnectedSources()
    texture = UsdShade.Shader(source.source.GetPrim())
    assert texture.GetInput("file").Get().resolvedPath == str(copy)


def test_packages_that_blender_brings_along_stay_off_the_path():
    assert usd._BUNDLED not in sys.path
