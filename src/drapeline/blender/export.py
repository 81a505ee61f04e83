"""Samples as files that other programs open: USD, glTF, Alembic, MDD, PC2 and OBJ sequences."""

import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from drapeline.blender.scene import add_material, add_mesh, new_scene
from drapeline.bodies.model import BodyModel
from drapeline.dataset.gltf import write_glb
from drapeline.dataset.reader import Sample
from drapeline.dataset.sample_meshes import scene_parts
from drapeline.dataset.scene_part import ScenePart, to_y_up
from drapeline.errors import InputError
from drapeline.frames import FPS
from drapeline.geometry.mesh import Mesh, triangulate, vertex_normals
from drapeline.geometry.obj import save_obj
from drapeline.geometry.point_cache import point_cache_writer
from drapeline.storage import atomic_folder

# Blender brings USD's library along, but its Python module leaves it off the path. It goes last and
# only for now, because Blender brings packages such as numpy along as well.
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
    texture coordinates as `st`; and its colour both as `displayColor` and as a UsdPreviewSurface.

    Args:
        path: the `.usdc` or `.usda` file, which must not exist.
        parts: parts of one sample, all with the same number of frames.
    """
    stage = Usd.Stage.CreateNew(str(path))
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
        _bind_material(stage, mesh, part)
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


def _bind_material(stage: Any, mesh: Any, part: ScenePart) -> None:
    path = f"{_ROOT}/materials/{part.name}"
    UsdGeom.Scope.Define(stage, f"{_ROOT}/materials")
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, f"{path}/surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    colour = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    colour.Set(Gf.Vec3f(*part.linear_colour))
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


def export_sample(
    folder: str | Path,
    output: str | Path,
    file_format: str,
    *,
    bodies: Mapping[str, BodyModel] | None = None,
) -> list[str]:
    """Export body and garments of one sample, moving in the world frame at 30 frames per second.

    - `usdc`: one file, Z up and metres as its header says; points, normals and velocities per
      frame.
    - `glb`: one file, Y up, one quantised morph target per frame.
    - `abc`: one file, Y up, points per frame, colours of corners.
    - `pc2`, `mdd`: per mesh an OBJ in rest pose and a cache for it, both Y up.
    - `obj`: per mesh a folder with an OBJ per frame, Y up.

    Y up is what importers of the last four expect; they turn it to their own axes.

    Args:
        folder: a CLOTH3D sample, ours or an original one.
        output: folder for the files; replaced as a whole.
        file_format: one of `FORMATS`.
        bodies: gender -> body model, for samples that store no body; such samples are exported
            without one if this is None.

    Returns:
        The names of the files that were written, relative to `output`.

    Raises:
        InputError: an unknown format, or a sample that cannot be read.
    """
    if file_format not in FORMATS:
        raise InputError(f"format '{file_format}' is unknown, expected one of {', '.join(FORMATS)}")
    with Sample(folder, bodies=bodies) as sample, atomic_folder(output) as scratch:
        if sample.meta is not None and sample.meta["status"] != "accepted":
            raise InputError(
                f"{folder}: the sample was {sample.meta['status']}"
                f" ({sample.meta['reason']}), expected an accepted one to export"
            )
        FORMATS[file_format](scratch, sample.id, scene_parts(sample))
        return sorted(str(p.relative_to(scratch)) for p in scratch.rglob("*") if p.is_file())


@contextmanager
def _copied(path: Path) -> Iterator[Path]:
    """A path for libraries of C++ to write to, copied by Python, which says so of a full disk.

    Alembic's ends the process, and USD's goes on with what it cannot read back.
    """
    with tempfile.TemporaryDirectory() as scratch:
        yield Path(scratch) / path.name
        shutil.copyfile(Path(scratch) / path.name, path)


def _export_usd(folder: Path, name: str, parts: list[ScenePart]) -> None:
    with _copied(folder / f"{name}.usdc") as path:
        write_usd(path, parts)


def _export_alembic(folder: Path, name: str, parts: list[ScenePart]) -> None:
    with _copied(folder / f"{name}.abc") as path:
        _scene_with_caches(parts, path.parent)
        bpy.ops.wm.alembic_export(
            filepath=str(path),
            start=0,
            end=parts[0].frame_count - 1,
            evaluation_mode="RENDER",
            face_sets=True,
            vcolors=True,
        )


def _export_gltf(folder: Path, name: str, parts: list[ScenePart]) -> None:
    write_glb(folder / f"{name}.glb", parts)


def _export_caches(suffix: str) -> Callable[[Path, str, list[ScenePart]], None]:
    def export(folder: Path, name: str, parts: list[ScenePart]) -> None:
        for part in parts:
            save_obj(
                folder / f"{part.name}.obj", _with_vertices(part.mesh, to_y_up(part.mesh.vertices))
            )
            with point_cache_writer(
                folder / f"{part.name}{suffix}",
                len(part.mesh.vertices),
                frame_count=part.frame_count,
            ) as cache:
                for points in part.frames():
                    cache.append(to_y_up(points))

    return export


def _export_obj_sequence(folder: Path, name: str, parts: list[ScenePart]) -> None:
    for part in parts:
        for frame, points in enumerate(part.frames()):
            path = folder / part.name / f"{part.name}_{frame:04d}.obj"
            save_obj(path, _with_vertices(part.mesh, to_y_up(points)))


FORMATS: dict[str, Callable[[Path, str, list[ScenePart]], None]] = {
    "usdc": _export_usd,
    "glb": _export_gltf,
    "abc": _export_alembic,
    "mdd": _export_caches(".mdd"),
    "pc2": _export_caches(".pc2"),
    "obj": _export_obj_sequence,
}


def _with_vertices(mesh: Mesh, points: np.ndarray) -> Mesh:
    return Mesh(points, mesh.faces, mesh.uv, mesh.uv_faces)


def _empty_scene(frame_count: int) -> None:
    """Scene frame f is the sample's frame f."""
    scene = new_scene()
    scene.render.fps = FPS
    scene.frame_start, scene.frame_end = 0, frame_count - 1
    scene.unit_settings.system = "METRIC"
    scene.frame_set(0)


def _scene_with_caches(parts: list[ScenePart], scratch: Path) -> None:
    """Every part driven by a PC2 file, so that memory does not grow with frames."""
    _empty_scene(parts[0].frame_count)
    for part in parts:
        path = scratch / f"{part.name}.pc2"
        with point_cache_writer(path, len(part.mesh.vertices)) as cache:
            for points in part.frames():
                cache.append(points)
        modifier = _add_part(part).modifiers.new("frames", "MESH_CACHE")
        modifier.cache_format = "PC2"
        modifier.filepath = str(path)
        modifier.frame_start = 0
        modifier.interpolation = "NONE"


def _add_part(part: ScenePart) -> bpy.types.Object:
    """The part as it is in frame 0, with texture coordinates and its colour.

    Alembic has no materials, so that the colour is also one of corners. Blender's exporter knows
    colours of corners in bytes alone, and writes them in sRGB.
    """
    thing = add_mesh(part.name, part.read(0, 1)[0], part.mesh.faces, part.colour)
    if part.mesh.uv is not None:
        corners = part.mesh.uv[part.mesh.uv_faces].astype(np.float32)
        thing.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", corners.ravel())
    colours = thing.data.color_attributes.new("colour", "BYTE_COLOR", "CORNER")
    colours.data.foreach_set("color", (*part.linear_colour, 1.0) * part.mesh.faces.size)
    add_material(thing, part.linear_colour, roughness=0.8)
    return thing
