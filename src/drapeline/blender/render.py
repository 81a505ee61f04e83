"""Images of a sample as in CLOTH3D's figure 14: colour, depth, normals, velocities, segments."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix
from PIL import Image

from drapeline.blender.scene import add_material, add_mesh, new_scene, shader_node
from drapeline.bodies.model import BodyModel
from drapeline.dataset.reader import Sample
from drapeline.dataset.sample_meshes import scene_parts
from drapeline.dataset.scene_part import ScenePart
from drapeline.errors import InputError
from drapeline.outfits.garment_types import GARMENTS
from drapeline.rendering.camera import Camera, frame_points, look_at
from drapeline.rendering.coco import CocoDocument
from drapeline.rendering.modalities import Seen, cast_rays
from drapeline.rule_log import progress
from drapeline.storage import atomic_folder, save_npz, write_json

# CLOTH3D's camera: a 50 mm lens before a 36 mm sensor, 640x480. Here it is zoomed from there.
_FOCAL_PX, _SIZE = 640 * 50 / 36, (640, 480)
_SENSOR_MM = 36.0
_SAMPLES = 12
_MARGIN = 0.06  # of a picture, around the person
_FASTEST_M_S = 3.0  # white in the picture of velocities
_DEEPEST_M = 65.535  # in a 16-bit PNG of millimetres
_SEGMENT_COLOURS = ((255, 255, 255), (214, 170, 140), (0, 114, 178), (213, 94, 0), (0, 158, 115))
# Blender's camera looks along -Z with +Y up, OpenCV's along +Z with -Y up.
_TO_BLENDER = np.diag([1.0, -1.0, -1.0, 1.0])


def render_modalities(
    folder: str | Path,
    output: str | Path,
    frames: Sequence[int],
    *,
    bodies: Mapping[str, BodyModel],
    cameras: int = 1,
) -> None:
    """Render chosen frames of a sample.

    Per frame f: `{f}_rgb.png` by Cycles; `{f}.npz` with `depth` (H, W) float32 metres, `normals`
    and `velocities` (H, W, 3) float32 in world axes, `flow` (H, W, 2) float32 pixels to the next
    frame, but for the last one, `segments` (H, W) uint8; the same as PNG (depth in 16-bit
    millimetres); `{f}_overview.png` beside one another. Names of camera k > 0 begin with
    `{f}_camera{k}`. `camera.json` holds intrinsics, world-to-camera matrices (OpenCV axes) and what
    the segments mean; `coco.json` boxes, masks and the joints in 2-D and 3-D.

    The camera stands where CLOTH3D's does, at `camLoc` looking along -X, and follows the root joint
    over the floor; further ones stand around the person. All have one lens, which is zoomed until
    the person fills the pictures.

    Args:
        folder: an accepted sample.
        output: folder to make.
        frames: numbers of frames; those beyond the sequence are refused.
        bodies: gender -> the body model that the sample was made with.
        cameras: how many, at equal angles.

    Raises:
        InputError: the sample was not accepted, or lacks a frame.
    """
    with Sample(folder, bodies=bodies) as sample, atomic_folder(output) as scratch:
        if sample.meta is not None and sample.meta["status"] != "accepted":
            raise InputError(
                f"{folder}: the sample was {sample.meta['status']}, expected an accepted one"
            )
        for frame in frames:
            if not 0 <= frame < len(sample):
                raise InputError(f"{folder}: frame {frame}, expected 0 to {len(sample) - 1}")
        parts = scene_parts(sample)
        coco = CocoDocument(sample.id, [part.name for part in parts[1:]], GARMENTS)
        extrinsics = {}
        views = [(frame, number) for frame in frames for number in range(cameras)]
        seen_by = [_camera(sample, frame, number / cameras) for frame, number in views]
        held = {f: np.concatenate([part.read(f, f + 1)[0] for part in parts]) for f in frames}
        seen_by = frame_points(seen_by, [held[frame] for frame, _ in views], _MARGIN)
        for (frame, number), camera in progress(
            list(zip(views, seen_by, strict=True)), label="modalities"
        ):
            name = f"{frame}_camera{number}" if number else str(frame)
            extrinsics[name] = {"world_to_camera": camera.world_to_camera.tolist()}
            seen = cast_rays([_moving_mesh(part, frame) for part in parts], camera)
            arrays = {
                "depth": seen.depth,
                "normals": seen.normals,
                "velocities": seen.carried[..., :3],
                "segments": seen.segments,
            }
            if frame + 1 < len(sample):
                after = _camera(sample, frame + 1, number / cameras)
                after = replace(after, intrinsics=camera.intrinsics)
                arrays["flow"] = _flow(seen, camera, after)
            save_npz(scratch / f"{name}.npz", **arrays)
            colour = scratch / f"{name}_rgb.png"
            render_colour(colour, parts, frame, camera)
            _write_images(scratch, name, arrays, colour)
            [joints] = sample.joints(frame, frame + 1)
            coco.add(colour.name, seen.segments, seen.depth, camera, joints)
        write_json(
            scratch / "camera.json",
            {
                "intrinsics": camera.intrinsics.tolist(),
                "width": _SIZE[0],
                "height": _SIZE[1],
                "frames": extrinsics,
                "segments": {"0": "background"}
                | {str(k + 1): part.name for k, part in enumerate(parts)},
            },
        )
        write_json(scratch / "coco.json", coco.finish())


def _camera(sample: Sample, frame: int, turn: float) -> Camera:
    """The camera in a frame, moved by a share of a whole turn around the person."""
    place = sample.info.camera_location
    x, _, height = (5.0, 0.0, 1.0) if place is None else map(float, place)
    [root] = sample.root_positions(frame, frame + 1)
    target = np.array([root[0], root[1], height])
    away = x * np.array([np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn), 0])
    return look_at(target + away, target, focal_px=_FOCAL_PX, size=_SIZE)


def _flow(seen: Seen, camera: Camera, after: Camera) -> np.ndarray:
    """(H, W, 2) float32 pixels that each surface point moves by until the next frame."""
    hit = seen.segments > 0
    now = camera.position + seen.depth[hit, None] * camera.rays()[hit]
    (here, _), (there, _) = camera.project(now), after.project(now + seen.carried[hit, 3:])
    flow = np.zeros((*hit.shape, 2), dtype=np.float32)
    flow[hit] = there - here
    return flow


def render_colour(path: Path, parts: Sequence[ScenePart], frame: int, camera: Camera) -> None:
    """Render one frame with Cycles on a grey floor under a soft sky and a lamp."""
    scene = new_scene()
    for part in parts:
        [points] = part.read(frame, frame + 1)
        thing = add_mesh(part.name, points, part.mesh.faces, corner_uv=part.mesh.corner_uv)
        add_material(thing, part.linear_colour, roughness=0.75, texture=part.texture)
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
    # Blender counts from the middle, in widths, and to where the picture moves.
    eye.data.shift_x = 0.5 - camera.intrinsics[0, 2] / camera.width
    eye.data.shift_y = (camera.intrinsics[1, 2] - camera.height / 2) / camera.width
    eye.matrix_world = Matrix(np.linalg.inv(camera.world_to_camera) @ _TO_BLENDER)
    scene.collection.objects.link(eye)
    scene.camera = eye
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.seed = "CPU", _SAMPLES, 0
    # Half of the time otherwise, for pictures that nobody can tell apart.
    scene.cycles.denoising_quality, scene.cycles.denoising_prefilter = "FAST", "NONE"
    scene.cycles.use_denoising = True
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.render.resolution_x, scene.render.resolution_y = camera.width, camera.height
    scene.view_settings.view_transform = "Standard"
    scene.render.image_settings.file_format = "PNG"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def _moving_mesh(part: ScenePart, frame: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices in metres, faces, and velocities in m/s beside the way in m to the next frame."""
    [velocities] = part.velocities(frame, frame + 1)
    points = part.read(frame, min(frame + 2, part.frame_count)).astype(np.float64)
    return points[0], part.mesh.faces, np.concatenate([velocities, points[-1] - points[0]], axis=1)


def _write_images(folder: Path, name: str, seen: Mapping[str, np.ndarray], colour: Path) -> None:
    depth, normals, segments = (seen[key] for key in ("depth", "normals", "segments"))
    hit = segments > 0
    millimetres = np.round(np.minimum(depth, _DEEPEST_M) * 1000).astype(np.uint16)
    Image.fromarray(millimetres).save(folder / f"{name}_depth.png")
    near, far = (depth[hit].min(), depth[hit].max()) if hit.any() else (0.0, 1.0)
    grey = np.where(hit, 230 - 200 * (depth - near) / max(far - near, 1e-6), 255)
    speed = np.linalg.norm(seen["velocities"], axis=-1) / _FASTEST_M_S
    blue, yellow = np.array([20.0, 30.0, 110.0]), np.array([255.0, 230.0, 40.0])
    heat = blue + np.minimum(speed, 1)[..., None] * (yellow - blue)
    palette = np.array(_SEGMENT_COLOURS, dtype=np.float64)
    pictures = {
        "depth_view": np.repeat(grey[..., None], 3, axis=2),
        "normals": np.where(hit[..., None], 127.5 * (normals + 1), 255),
        "velocity": np.where(hit[..., None], heat, 255),
        "segments": palette[np.minimum(segments, len(palette) - 1)],
    }
    pictures = {name: picture.astype(np.uint8) for name, picture in pictures.items()}
    with Image.open(colour) as image:
        row = [np.asarray(image.convert("RGB")), *pictures.values()]
    for shown in ("normals", "velocity"):
        Image.fromarray(pictures[shown]).save(folder / f"{name}_{shown}.png")
    # Pixel values are the numbers of the segments, the palette is for people.
    indexed = Image.fromarray(segments, mode="P")
    indexed.putpalette(palette.astype(np.uint8).tobytes())
    indexed.save(folder / f"{name}_segments.png")
    Image.fromarray(np.concatenate(row, axis=1)).save(folder / f"{name}_overview.png")
