"""Render a still and a moving picture of a sample."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from drapeline.dataset.labels import BODY
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import meta_path, read_meta
from drapeline.dataset.sample_meshes import scene_parts
from drapeline.dataset.scene_part import ScenePart
from drapeline.rendering.animated_png import save_animation
from drapeline.rendering.camera import Camera, facing_direction, look_at, view_direction
from drapeline.rendering.picture_grid import text_card
from drapeline.rendering.raytracer import ColouredMesh, raytrace
from drapeline.report.style import SKIN
from drapeline.rule_log import progress
from drapeline.storage import atomic_file

_GLOSS = {"silk": 0.22, "leather": 0.3}  # cotton and denim have no highlights
_DISTANCE_M = 7.0
_SEEN_HEIGHT_M = 2.3
_TARGET_HEIGHT_M = 0.93
_FILLED = 0.95  # share of the picture that is filled by movements that reach farther than usual
_TURN_DEG = 28.0  # the camera stands this far to the side of where the body faces
_RISE = 0.2


def render_gallery(
    folder: str | Path,
    still: str | Path,
    moving: str | Path,
    *,
    still_size: tuple[int, int] = (480, 640),
    moving_size: tuple[int, int] = (240, 320),
    moving_frames: int = 16,
) -> None:
    """Render a sample's middle frame and an animation of it, at the same scale for all samples.

    The camera follows the body along the floor. A sample that was not accepted gets a card with
    its status and reason in place of both pictures.

    Args:
        folder: a sample.
        still: the PNG to write.
        moving: the animated PNG to write; it loops.
        still_size, moving_size: width and height in pixels.
        moving_frames: pictures of the animation, spread evenly over the sequence.

    Raises:
        InputError: the sample's files are missing or damaged.
    """
    meta = read_meta(folder) if meta_path(folder).is_file() else {"status": "accepted"}
    if meta["status"] != "accepted":
        _save_still(still, _card(meta, still_size))
        _save_still(moving, _card(meta, moving_size))
        return
    with Sample(folder) as sample:
        parts = scene_parts(sample)
        frames = np.unique(np.linspace(0, len(sample) - 1, moving_frames).astype(int)).tolist()
        middle = frames[len(frames) // 2]
        camera = _cameras(sample, parts, frames, still_size)[middle]
        _save_still(still, _shot(sample, parts, middle, camera))
        cameras = _cameras(sample, parts, frames, moving_size)
        pictures = [
            _shot(sample, parts, frame, cameras[frame], samples=6)
            for frame in progress(frames, label="gallery")
        ]
        save_animation(moving, pictures, round(1000 * len(sample) / sample.fps / len(frames)))


def _shot(
    sample: Sample,
    parts: Sequence[ScenePart],
    frame: int,
    camera: Camera,
    *,
    samples: int = 12,
) -> np.ndarray:
    painted = [
        ColouredMesh(
            part.read(frame, frame + 1)[0],
            part.mesh.faces,
            SKIN if part.name == BODY else part.colour,
            _GLOSS.get(sample.fabrics.get(part.name) or "", 0.0),
        )
        for part in parts
    ]
    target = camera.position + _DISTANCE_M * camera.axes[2]
    return raytrace(painted, camera, floor_centre=target[:2], samples=samples)


def _cameras(
    sample: Sample, parts: Sequence[ScenePart], frames: Sequence[int], size: tuple[int, int]
) -> dict[int, Camera]:
    """Frame -> camera; all look in one direction, at one scale."""
    front = facing_direction(sample.info.poses[frames[len(frames) // 2], :3])
    direction = view_direction(front, turn_deg=_TURN_DEG, rise=_RISE)
    targets = sample.root_positions()[list(frames)]
    targets[:, 2] = _TARGET_HEIGHT_M
    focal_px = size[1] * _DISTANCE_M / _SEEN_HEIGHT_M

    def shots(focal_px: float) -> dict[int, Camera]:
        return {
            frame: look_at(target + _DISTANCE_M * direction, target, focal_px=focal_px, size=size)
            for frame, target in zip(frames, targets, strict=True)
        }

    half = np.array(size) / 2
    reach = 0.0
    for frame, camera in shots(focal_px).items():
        for part in parts:
            seen, _ = camera.project(part.read(frame, frame + 1)[0])
            reach = max(reach, float(np.abs(seen / half - 1).max()))
    return shots(focal_px * min(1.0, _FILLED / reach))


def _card(meta: Mapping[str, Any], size: tuple[int, int]) -> np.ndarray:
    return text_card(f"{meta['id']}: {meta['status']}", meta.get("reason", ""), size)


def _save_still(path: str | Path, picture: np.ndarray) -> None:
    with atomic_file(path) as scratch:
        Image.fromarray(picture).save(scratch, format="PNG", optimize=True)
