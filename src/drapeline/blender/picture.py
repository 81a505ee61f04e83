"""Quick pictures of meshes with Blender's Workbench engine."""

from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

from drapeline.storage import atomic_file


def add_mesh(
    name: str,
    vertices: np.ndarray,
    faces: np.ndarray,
    colour: Sequence[float] = (0.6, 0.6, 0.6),
) -> bpy.types.Object:
    """Add a smooth-shaded mesh object, vertices (V, 3) metres, to the current scene."""
    data = bpy.data.meshes.new(name)
    count, size = faces.shape
    data.vertices.add(len(vertices))
    data.vertices.foreach_set("co", np.ascontiguousarray(vertices, dtype=np.float32).ravel())
    data.loops.add(count * size)
    data.loops.foreach_set("vertex_index", np.ascontiguousarray(faces, dtype=np.int32).ravel())
    data.polygons.add(count)
    data.polygons.foreach_set("loop_start", np.arange(0, count * size, size, dtype=np.int32))
    data.polygons.foreach_set("use_smooth", np.ones(count, dtype=bool))
    data.update(calc_edges=True)
    thing = bpy.data.objects.new(name, data)
    thing.color = (*colour, 1.0)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def new_scene() -> bpy.types.Scene:
    """An empty Blender file with an empty scene."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.context.scene


def picture(
    path: str | Path,
    meshes: Sequence[tuple[np.ndarray, np.ndarray, Sequence[float]]],
    *,
    size: tuple[int, int] = (480, 640),
    view: Sequence[float] = (0.0, -1.0, 0.12),
    margin: float = 1.08,
) -> None:
    """Render meshes to a PNG, orthographic, framed to fit.

    Args:
        meshes: (vertices (V, 3) Z up, faces (F, 3|4), RGB in 0-1) each.
        size: width and height in pixels.
        view: direction from the subject to the camera; (0, -1, 0) is the front.
    """
    scene = new_scene()
    for index, (vertices, faces, colour) in enumerate(meshes):
        add_mesh(f"mesh{index}", vertices, faces, colour)
    points = np.concatenate([m[0] for m in meshes])
    direction = Vector(view).normalized()
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.type = "ORTHO"
    camera.rotation_euler = direction.to_track_quat("Z", "Y").to_euler()
    right, up = (np.array(camera.rotation_euler.to_matrix().col[i]) for i in (0, 1))
    across, along = points @ right, points @ up
    width, height = size
    span = max(np.ptp(across), np.ptp(along) * width / height) * margin
    camera.data.ortho_scale = span * max(1.0, height / width)
    centre = right * (across.max() + across.min()) / 2 + up * (along.max() + along.min()) / 2
    camera.location = Vector(centre) + direction * 20
    camera.data.clip_end = 100
    scene.collection.objects.link(camera)
    scene.camera = camera
    shade_with_workbench(scene)
    scene.render.resolution_x, scene.render.resolution_y = size
    with atomic_file(path) as scratch:
        scene.render.filepath = str(scratch)
        bpy.ops.render.render(write_still=True)


def shade_with_workbench(scene: bpy.types.Scene) -> None:
    """Studio light, object colours, cavity shading on white."""
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.render.image_settings.file_format = "PNG"
    scene.render.film_transparent = False
    scene.world = bpy.data.worlds.new("white")
    scene.world.color = (1, 1, 1)
    scene.view_settings.view_transform = "Standard"
    shading = scene.display.shading
    shading.light = "STUDIO"
    shading.color_type = "OBJECT"
    shading.show_cavity = True
    shading.cavity_type = "BOTH"
    # Shadows and more anti-aliasing samples double the time in a software renderer.
    shading.show_shadows = False
    scene.display.render_aa = "5"
