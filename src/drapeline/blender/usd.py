"""Moving meshes as USD, by Pixar's library: the package usd-core, or Blender's own copy."""

import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drapeline.dataset.scene_part import ScenePart
from drapeline.frames import FPS
from drapeline.geometry.mesh import triangulate, vertex_normals
from drapeline.storage import atomic_file, copied_file

try:
    from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt
except ImportError:
    import bpy

    # Blender brings it along, but leaves it off the path. It goes last and only for now, because
    # Blender brings packages such as numpy along as well.
    _BUNDLED = str(
        Path(bpy.utils.resource_path("LOCAL"))
        / f"python/lib/python{sys.version_info.major}.{sys.version_info.minor}/site-packages"
    )
    sys.path.append(_BUNDLED)
    try:
        from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt
    finally:
        sys.path.remove(_BUNDLED)

_CHUNK = 32  # frames held in memory at once
_ROOT = "/sample"


def write_usd(path: str | Path, parts: Sequence[ScenePart]) -> None:
    """Write parts, Z up and in metres, at 30 time codes and frames per second from frame 0 on.

    Each part is a mesh with points, normals per vertex, velocities in m/s and extent per frame;
    texture coordinates as `st`; and its colour both as `displayColor` and as a UsdPreviewSurface,
    or its print, a picture beside the file, `{file}_{part}.png`.

    Args:
        path: the `.usdc` or `.usda` file.
        parts: parts of one sample, all with the same number of frames.
    """
    with copied_file(path) as scratch:
        stage = Usd.Stage.CreateNew(str(scratch))
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        stage.SetTimeCodesPerSecond(FPS)
        stage.SetFramesPerSecond(FPS)
        stage.SetStartTimeCode(0)
        stage.SetEndTimeCode(parts[0].frame_count - 1)
        root = UsdGeom.Xform.Define(stage, _ROOT)
        Usd.ModelAPI(root).SetKind("component")
        stage.SetDefaultPrim(root.GetPrim())
        for part in parts:
            mesh = _define_mesh(stage, part)
            _bind_material(stage, mesh, part, _lay_beside(Path(path), part))
            _animate(stage, mesh, part)
        stage.Save()


def _define_mesh(stage: Any, part: ScenePart) -> Any:
    faces = part.mesh.faces
    mesh = UsdGeom.Mesh.Define(stage, f"{_ROOT}/{part.name}")
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(True)  # cloth is a single sheet, seen from both sides
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(len(faces), faces.shape[1]))
    mesh.CreateFaceVertexIndicesAttr(_array(Vt.IntArray, faces.ravel()))
    mesh.CreateDisplayColorAttr([Gf.Vec3f(*part.linear_colour)])
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    if part.mesh.uv is not None and part.mesh.uv_faces is not None:
        uv = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
            "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
        )
        uv.Set(_array(Vt.Vec2fArray, part.mesh.uv))
        uv.SetIndices(_array(Vt.IntArray, part.mesh.uv_faces.ravel()))
    return mesh


def _lay_beside(path: Path, part: ScenePart) -> str:
    """Name of a copy of a part's print beside the file; empty if it has none."""
    if part.texture is None or part.mesh.uv is None:
        return ""
    copy = path.with_name(f"{path.stem}_{part.name}.png")
    with atomic_file(copy) as scratch:
        shutil.copyfile(part.texture, scratch)
    return copy.name


def _bind_material(stage: Any, mesh: Any, part: ScenePart, picture: str) -> None:
    path = f"{_ROOT}/materials/{part.name}"
    UsdGeom.Scope.Define(stage, f"{_ROOT}/materials")
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, f"{path}/surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    colour = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    colour.Set(Gf.Vec3f(*part.linear_colour))
    if picture:
        place = UsdShade.Shader.Define(stage, f"{path}/st")
        place.CreateIdAttr("UsdPrimvarReader_float2")
        place.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
        place.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        texture = UsdShade.Shader.Define(stage, f"{path}/print")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(f"./{picture}")
        texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
        texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
            place.ConnectableAPI(), "result"
        )
        texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
        colour.ConnectToSource(texture.ConnectableAPI(), "rgb")
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.8)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)


def _animate(stage: Any, mesh: Any, part: ScenePart) -> None:
    triangles = triangulate(part.mesh.faces)
    attributes = {
        "points": mesh.CreatePointsAttr(),
        "normals": mesh.CreateNormalsAttr(),
        "velocities": mesh.CreateVelocitiesAttr(),
        "extent": mesh.CreateExtentAttr(),
    }
    for start in range(0, part.frame_count, _CHUNK):
        stop = min(start + _CHUNK, part.frame_count)
        frames = zip(part.read(start, stop), part.velocities(start, stop), strict=True)
        for frame, (points, velocities) in enumerate(frames, start):
            values = {
                "points": points,
                "normals": vertex_normals(points, triangles),
                "velocities": velocities,
                "extent": np.stack([points.min(axis=0), points.max(axis=0)]),
            }
            for name, attribute in attributes.items():
                attribute.Set(_array(Vt.Vec3fArray, values[name]), frame)
        stage.Save()  # lets go of the frames so far


def _array(kind: Any, values: np.ndarray) -> Any:
    dtype = np.int32 if kind is Vt.IntArray else np.float32
    return kind.FromNumpy(np.ascontiguousarray(values, dtype=dtype))
