"""Pictures of samples: a still and a moving one of each, and a sheet of the learning group."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from drapeline.dataset.reader import Sample
from drapeline.dataset.record import clip_name, meta_path, read_meta, read_record
from drapeline.dataset.sample_meshes import scene_parts
from drapeline.dataset.scene_part import BODY_COLOUR, PLAIN_COLOUR, ScenePart
from drapeline.dataset.worst_frame import read_worst_frame
from drapeline.errors import InputError
from drapeline.rendering.camera import (
    Camera,
    facing_direction,
    frame_points,
    look_at,
    view_direction,
)
from drapeline.rendering.pictures import (
    save_animation,
    save_contact_sheet,
    save_picture,
    text_card,
)
from drapeline.rendering.raytracer import ColouredMesh, raytrace
from drapeline.report.dataset.paint import paint
from drapeline.report.html import write_page
from drapeline.rule_log import progress

_DISTANCE_M = 7.0
_TARGET_HEIGHT_M = 0.93
_MARGIN = 0.05  # of the picture's height and width, around the figure
_TURN_DEG = 28.0  # the camera stands this far to the side of where the body faces
_RISE = 0.2
_SIZE = (210, 280)
_CARD_SHARE = 0.3  # of a picture of what was not accepted
_WRONG_COLOUR = (0.86, 0.15, 0.12)
_COLUMNS = 8


def render_gallery(
    folder: str | Path,
    still: str | Path,
    moving: str | Path,
    *,
    still_size: tuple[int, int] = (480, 640),
    moving_size: tuple[int, int] = (360, 480),
    frame_step: int = 2,
) -> None:
    """Render a sample's middle frame and an animation of it; both are filled by the figure.

    The camera follows the body along the floor at one scale. Of a sample that was not accepted both
    pictures show the worst frame, in red what is wrong with it, above a card with its status and
    reason; or the card alone if nothing was simulated.

    Args:
        still: the PNG to write.
        moving: the animated PNG to write; it loops.
        still_size, moving_size: width and height in pixels.
        frame_step: of each so many frames one is shown; 2 gives 15 pictures per second.

    Raises:
        InputError: the sample's files are missing or damaged.
    """
    meta = read_meta(folder) if meta_path(folder).is_file() else {"status": "accepted"}
    if meta["status"] != "accepted":
        save_picture(still, _rejected(folder, meta, still_size))
        save_picture(moving, _rejected(folder, meta, moving_size))
        return
    with Sample(folder) as sample:
        parts = scene_parts(sample)
        save_picture(still, _middle_shot(sample, parts, still_size))
        frames = range(0, len(sample), frame_step)
        cameras = _cameras(sample, parts, frames, moving_size)
        pictures = [
            _shot(sample, parts, frame, camera, samples=8)
            for frame, camera in progress(
                zip(frames, cameras, strict=True), total=len(frames), label="gallery"
            )
        ]
        save_animation(moving, pictures, 1000 * frame_step / sample.fps)


_INDEX_STYLE = """<style>
.samples { display: grid; gap: .8rem;
  grid-template-columns: repeat(auto-fill, minmax(13rem, 1fr)); }
.samples figure { margin: 0; font-size: .8rem; color: #444; }
.samples img { width: 100%; display: block; }
</style>"""


def write_index(folder: str | Path) -> None:
    """Write `index.html` of the moving pictures that there are below a folder by now.

    A browser that shows the page loads it again every half minute, so that it fills up.
    """
    folder = Path(folder)
    found = sorted(folder.rglob("*_moving.png"))
    shown = (
        f'<figure><img src="{escape(str(path.relative_to(folder)))}" loading="lazy" alt="">'
        f"<figcaption>{escape(path.name.removesuffix('_moving.png'))}</figcaption></figure>"
        for path in found
    )
    write_page(
        folder / "index.html",
        "Samples so far",
        f'<meta http-equiv="refresh" content="30">{_INDEX_STYLE}',
        f"<p>{len(found)} so far. This page fills up while samples are made.</p>",
        f'<div class="samples">{"".join(shown)}</div>',
    )


def render_still(folder: str | Path, size: tuple[int, int]) -> np.ndarray:
    """A sample's middle frame (height, width, 3) uint8, filled by the figure.

    Args:
        folder: an accepted sample.
        size: width and height in pixels.

    Raises:
        InputError: the sample's files are missing or damaged.
    """
    with Sample(folder) as sample:
        return _middle_shot(sample, scene_parts(sample), size)


def _middle_shot(sample: Sample, parts: Sequence[ScenePart], size: tuple[int, int]) -> np.ndarray:
    middle = len(sample) // 2
    (camera,) = _cameras(sample, parts, [middle], size)
    return _shot(sample, parts, middle, camera)


def _shot(
    sample: Sample, parts: Sequence[ScenePart], frame: int, camera: Camera, *, samples: int = 16
) -> np.ndarray:
    painted = [
        paint(part, part.read(frame, frame + 1)[0], sample.fabrics.get(part.name)) for part in parts
    ]
    target = camera.position + _DISTANCE_M * camera.axes[2]
    return raytrace(painted, camera, floor_centre=target[:2], samples=samples)


def _cameras(
    sample: Sample, parts: Sequence[ScenePart], frames: Sequence[int], size: tuple[int, int]
) -> list[Camera]:
    """The cameras of frames; all look in one direction, at one scale."""
    front = facing_direction(sample.info.poses[frames[len(frames) // 2], :3])
    direction = view_direction(front, turn_deg=_TURN_DEG, rise=_RISE)
    targets = sample.root_positions()[list(frames)]
    targets[:, 2] = _TARGET_HEIGHT_M
    cameras = [
        look_at(target + _DISTANCE_M * direction, target, focal_px=size[1], size=size)
        for target in targets
    ]
    figures = [
        np.concatenate([part.read(frame, frame + 1)[0] for part in parts]) for frame in frames
    ]
    return frame_points(cameras, figures, _MARGIN)


def _rejected(folder: str | Path, meta: Mapping[str, Any], size: tuple[int, int]) -> np.ndarray:
    worst = read_worst_frame(folder)
    if worst is None:
        return _card(meta, size)
    width, height = size
    card = round(_CARD_SHARE * height)
    size = width, height - card
    painted = [ColouredMesh(worst.body, worst.body_faces, BODY_COLOUR)]
    for vertices, faces, wrong in worst.garments.values():
        marked = wrong[faces].any(axis=1)
        for chosen, colour in ((~marked, PLAIN_COLOUR), (marked, _WRONG_COLOUR)):
            if chosen.any():
                painted.append(ColouredMesh(vertices, faces[chosen], colour))
    points = np.concatenate([mesh.vertices for mesh in painted])
    ground = np.array([0, 0, points[:, 2].min()])
    painted = [replace(mesh, vertices=mesh.vertices - ground) for mesh in painted]
    points = points - ground
    target = (points.min(axis=0) + points.max(axis=0)) / 2
    front = facing_direction(worst.root_rotation)
    direction = view_direction(front, turn_deg=_TURN_DEG, rise=_RISE)
    camera = look_at(target + _DISTANCE_M * direction, target, focal_px=size[1], size=size)
    (camera,) = frame_points([camera], [points], _MARGIN)
    picture = raytrace(painted, camera)
    title = f"{meta['id']}: {meta['status']}, frame {worst.frame}"
    return np.concatenate([picture, text_card(title, meta.get("reason", ""), (width, card))])


def _card(meta: Mapping[str, Any], size: tuple[int, int]) -> np.ndarray:
    return text_card(f"{meta['id']}: {meta['status']}", meta.get("reason", ""), size)


def plot_group(path: str | Path, samples: Sequence[str | Path], *, most: int) -> int:
    """Draw the middle frames of accepted samples, spread evenly; returns their number.

    Args:
        samples: folders of all samples of the group.
        most: samples to show at most.

    Raises:
        InputError: no sample was accepted, or a file is unusable.
    """
    records = [record for record in map(read_record, samples) if record.accepted]
    if not records:
        raise InputError(
            f"{path}: none of {len(samples)} samples was accepted, expected one or more to show"
        )
    rows = np.linspace(0, len(records) - 1, min(most, len(records))).round().astype(int)
    shown = [records[row] for row in rows]
    pictures = [
        (render_still(record.folder, _SIZE), _caption(record.meta))
        for record in progress(shown, label="samples")
    ]
    save_contact_sheet(path, pictures, min(_COLUMNS, len(pictures)), letter=11)
    return len(pictures)


def _caption(meta: Mapping[str, Any]) -> str:
    motion = meta["motion"]
    clip, turned = clip_name(meta, meta["id"]), ", mirrored" if motion["mirrored"] else ""
    return f"{meta['id']}: {clip} at {motion['speed']:.2f}{turned}"
