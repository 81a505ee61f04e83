"""Images of a sample as in CLOTH3D's figure 14: colour, depth, normals, velocities, segments."""

from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix
from PIL import Image

from drapeline.blender.scene import add_material, add_mesh, new_scene, shader_node
from drapeline.dataset.reader import Sample
from drapeline.dataset.sample_meshes import scene_parts
from drapeline.dataset.scene_part import ScenePart
from drapeline.errors import InputError
from drapeline.rendering.camera import Camera, look_at
from drapeline.rendering.modalities import Seen, cast_rays
from drapeline.rule_log import progress
from drapeline.storage import atomic_folder, save_npz, write_json

# CLOTH3D's camera: a 50 mm lens before a 36 mm sensor, 640x480.
FOCAL_PX, SIZE = 640 * 50 / 36, (640, 480)
_SENSOR_MM = 36.0
_SAMPLES = 16
_FASTEST_M_S = 3.0  # white in the picture of velocities
_DEEPEST_M = 65.535  # in a 16-bit PNG of millimetres
_SEGMENT_COLOURS = ((255, 255, 255), (214, 170, 140), (0, 114, 178), (213, 94, 0), (0, 158, 115))
# Blender's camera looks along -Z with +Y up, OpenCV's along +Z with -Y up.
_TO_BLENDER = np.diag([1.0, -1.0, -1.0, 1.0])


def render_modalities(folder: str | Path, output: str | Path, frames: Sequence[int]) -> None:
    """Render chosen frames of a sample.

    Per frame f: `{f}_rgb.png` by Cycles; `{f}.npz` with `depth` (H, W) float32 metres, `normals`
    and `velocities` (H, W, 3) float32 in world axes, `segments` (H, W) uint8; the same as PNG
    (depth in 16-bit millimetres); `{f}_overview.png` beside one another. `camera.json` holds
    intrinsics, world-to-camera matrices (OpenCV axes) and what the segments mean.

    The camera is CLOTH3D's, at `camLoc` looking along -X, and follows the root joint over the
    floor so that no one walks out of the picture.

    Args:
        folder: an accepted sample.
        output: folder to make.
        frames: numbers of frames; those beyond the sequence are refused.

    Raises:
        InputError: the sample was not accepted, or lacks a frame.
    """
    with Sample(folder) as sample, atomic_folder(output) as scratch:
        if sample.meta is not None and sample.meta["status"] != "accepted":
            raise InputError(
                f"{folder}: the sample was {sample.meta['status']}, expected an accepted one"
            )
        for frame in frames:
            if not 0 <= frame < len(sample):
                raise InputError(f"{folder}: frame {frame}, expected 0 to {len(sample) - 1}")
        parts = scene_parts(sample)
        place = sample.info.camera_location
        place = np.array([5.0, 0.0, 1.0]) if place is None else np.asarray(place, np.float64)
        cameras = {}
        for frame in progress(list(frames), label="modalities"):
            root = sample.root_positions(frame, frame + 1)[0]
            target = np.array([root[0], root[1], place[2]])
            camera = look_at(target + [place[0], 0, 0], target, focal_px=FOCAL_PX, size=SIZE)
            cameras[str(frame)] = {"world_to_camera": camera.world_to_camera.tolist()}
            seen = cast_rays([_moving_mesh(part, frame) for part in parts], camera)
            colour = scratch / f"{frame}_rgb.png"
            render_colour(colour, parts, frame, camera)
            _write_images(scratch, frame, seen, colour)
        write_json(
            scratch / "camera.json",
            {
                "intrinsics": camera.intrinsics.tolist(),
                "width": SIZE[0],
                "height": SIZE[1],
                "frames": cameras,
                "segments": {"0": "background"}
                | {str(k + 1): part.name for k, part in enumerate(parts)},
            },
        )


def render_colour(path: Path, parts: Sequence[ScenePart], frame: int, camera: Camera) -> None:
    """Render one frame with Cycles on a grey floor under a soft sky and a lamp."""
    scene = new_scene()
    for part in parts:
        thing = add_mesh(part.name, part.read(frame, frame + 1)[0], part.mesh.faces)
        add_material(thing, part.linear_colour, roughness=0.75)
    reach = 30.0
    corners = np.array(
        [[-reach, -reach, 0], [reach, -reach, 0], [reach, reach, 0], [-reach, reach, 0]]
    )
    floor = add_mesh("floor", corners + [*camera.position[:2], 0.0], np.array([[0, 1, 2, 3]]))
    add_material(floor, (0.604, 0.604, 0.604), roughness=1.0)
    lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "SUN"))
    lamp.data.energy, lamp.data.angle = 3.0, 0.3
    lamp.rotation_euler = (0.5, 0.6, 0.0)
    scene.collection.objects.link(lamp)
    scene.world = bpy.data.worlds.new("sky")
    sky = shader_node(scene.world, "ShaderNodeBackground")
    sky.inputs["Color"].default_value = (0.8, 0.85, 0.95, 1)
    sky.inputs["Strength"].default_value = 0.7
    eye = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    eye.data.sensor_width = _SENSOR_MM
    eye.data.lens = camera.intrinsics[0, 0] * _SENSOR_MM / camera.width
    eye.matrix_world = Matrix(np.linalg.inv(camera.world_to_camera) @ _TO_BLENDER)
    scene.collection.objects.link(eye)
    scene.camera = eye
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.seed = "CPU", _SAMPLES, 0
    scene.cycles.use_denoising = True
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.render.resolution_x, scene.render.resolution_y = camera.width, camera.height
    scene.view_settings.view_transform = "Standard"
    scene.render.image_settings.file_format = "PNG"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def _moving_mesh(part: ScenePart, frame: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices in metres, faces, and velocities in m/s."""
    [points], [velocities] = part.read(frame, frame + 1), part.velocities(frame, frame + 1)
    return points.astype(np.float64), part.mesh.faces, velocities


def _write_images(folder: Path, frame: int, seen: Seen, colour: Path) -> None:
    save_npz(
        folder / f"{frame}.npz",
        depth=seen.depth,
        normals=seen.normals,
        velocities=seen.velocities,
        segments=seen.segments,
    )
    hit = seen.segments > 0
    millimetres = np.round(np.minimum(seen.depth, _DEEPEST_M) * 1000).astype(np.uint16)
    Image.fromarray(millimetres).save(folder / f"{frame}_depth.png")
    near, far = (seen.depth[hit].min(), seen.depth[hit].max()) if hit.any() else (0.0, 1.0)
    grey = np.where(hit, 230 - 200 * (seen.depth - near) / max(far - near, 1e-6), 255)
    speed = np.linalg.norm(seen.velocities, axis=-1) / _FASTEST_M_S
    blue, yellow = np.array([20.0, 30.0, 110.0]), np.array([255.0, 230.0, 40.0])
    heat = blue + np.minimum(speed, 1)[..., None] * (yellow - blue)
    palette = np.array(_SEGMENT_COLOURS, dtype=np.float64)
    pictures = {
        "depth_view": np.repeat(grey[..., None], 3, axis=2),
        "normals": np.where(hit[..., None], 127.5 * (seen.normals + 1), 255),
        "velocity": np.where(hit[..., None], heat, 255),
        "segments": palette[np.minimum(seen.segments, len(palette) - 1)],
    }
    pictures = {name: picture.astype(np.uint8) for name, picture in pictures.items()}
    with Image.open(colour) as image:
        row = [np.asarray(image.convert("RGB")), *pictures.values()]
    for name in ("normals", "velocity"):
        Image.fromarray(pictures[name]).save(folder / f"{frame}_{name}.png")
    # Pixel values are the numbers of the segments, the palette is for people.
    indexed = Image.fromarray(seen.segments, mode="P")
    indexed.putpalette(palette.astype(np.uint8).tobytes())
    indexed.save(folder / f"{frame}_segments.png")
    Image.fromarray(np.concatenate(row, axis=1)).save(folder / f"{frame}_overview.png")
