"""Samples as files that other programs open: USD, glTF, Alembic, MDD, PC2 and OBJ sequences."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import bpy

from drapeline.blender.scene import add_material, add_mesh, new_scene
from drapeline.blender.usd import write_usd
from drapeline.bodies.model import BodyModel
from drapeline.dataset.gltf import write_glb
from drapeline.dataset.mesh_files import write_caches, write_obj_sequence
from drapeline.dataset.reader import Sample
from drapeline.dataset.sample_meshes import scene_parts
from drapeline.dataset.scene_part import ScenePart
from drapeline.errors import InputError
from drapeline.frames import FPS
from drapeline.geometry.point_cache import point_cache_writer
from drapeline.storage import atomic_folder, copied_file


def export_sample(
    folder: str | Path,
    output: str | Path,
    file_format: str,
    *,
    bodies: Mapping[str, BodyModel] | None = None,
) -> list[str]:
    """Export body and garments of one sample, moving in the world frame at 30 frames per second.

    - `usdc`: one file, Z up and metres as its header says; points, normals and velocities per
      frame; prints lie beside it.
    - `glb`: one file, Y up, see `write_glb`.
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


def _export_usd(folder: Path, name: str, parts: list[ScenePart]) -> None:
    write_usd(folder / f"{name}.usdc", parts)


def _export_alembic(folder: Path, name: str, parts: list[ScenePart]) -> None:
    write_alembic(folder / f"{name}.abc", parts)


def write_alembic(path: str | Path, parts: Sequence[ScenePart]) -> None:
    """Write parts, Y up and in metres, with points in every frame and colours of corners.

    Args:
        path: the `.abc` file.
        parts: parts of one sample, all with the same number of frames.
    """
    with copied_file(path) as scratch:
        _scene_with_caches(parts, scratch.parent)
        bpy.ops.wm.alembic_export(
            filepath=str(scratch),
            start=0,
            end=parts[0].frame_count - 1,
            evaluation_mode="RENDER",
            face_sets=True,
            vcolors=True,
        )


def _export_gltf(folder: Path, name: str, parts: list[ScenePart]) -> None:
    write_glb(folder / f"{name}.glb", parts)


FORMATS: dict[str, Callable[[Path, str, list[ScenePart]], None]] = {
    "usdc": _export_usd,
    "glb": _export_gltf,
    "abc": _export_alembic,
    "mdd": lambda folder, _, parts: write_caches(folder, parts, ".mdd"),
    "pc2": lambda folder, _, parts: write_caches(folder, parts, ".pc2"),
    "obj": lambda folder, _, parts: write_obj_sequence(folder, parts),
}


def _empty_scene(frame_count: int) -> None:
    """Scene frame f is the sample's frame f."""
    scene = new_scene()
    scene.render.fps = FPS
    scene.frame_start, scene.frame_end = 0, frame_count - 1
    scene.unit_settings.system = "METRIC"
    scene.frame_set(0)


def _scene_with_caches(parts: Sequence[ScenePart], scratch: Path) -> None:
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
    thing = add_mesh(
        part.name, part.read(0, 1)[0], part.mesh.faces, part.colour, part.mesh.corner_uv
    )
    colours = thing.data.color_attributes.new("colour", "BYTE_COLOR", "CORNER")
    colours.data.foreach_set("color", (*part.linear_colour, 1.0) * part.mesh.faces.size)
    add_material(thing, part.linear_colour, roughness=0.8)
    return thing
