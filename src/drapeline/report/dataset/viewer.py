"""Samples as one HTML page to turn and play, which needs neither a network nor libraries."""

import base64
import io
import json
import zlib
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from html import escape
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from PIL import Image

from drapeline.dataset.pictures import halved_picture
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import SPLITS
from drapeline.dataset.sample_meshes import scene_parts
from drapeline.dataset.scene_part import ScenePart
from drapeline.errors import InputError
from drapeline.frames import FPS
from drapeline.geometry.coarsen import coarsen_faces
from drapeline.geometry.mesh import Mesh, split_at_seams
from drapeline.outfits.garment_types import BODY
from drapeline.storage import atomic_file

FRAMES_MAX = 60
BYTES_MAX = 6_000_000  # of a page on its own
# Browsers do not open frames with data URLs beyond 2 MiB, which is how a report holds its pages.
REPORT_BYTES_MAX = 1_450_000
STEPS_M = (0.0002, 0.0005, 0.001)  # what vertices are rounded to
_LEVELS = 2**16 - 1
_PAGE_BYTES = 25_000  # without its meshes
_PRINT_COLOURS = 24
_TRIANGLES = 5000  # of each part, side by side
_APART_M = 0.15  # between people side by side


def example_sample(dataset: str | Path) -> Path | None:
    """Folder of the first accepted sample of the test split, else of another one, or None."""
    for split in ("test", *(name for name in SPLITS if name != "test")):
        for folder in sorted((Path(dataset) / split).glob("*")):
            if (folder / "info.mat").is_file():
                return folder
    return None


def write_viewer(path: str | Path, folder: str | Path | None, *, bytes_max: int = BYTES_MAX) -> int:
    """Write the page of a sample, or of the reason why it was not accepted.

    Args:
        folder: of the sample, or None if there is none to show.
        bytes_max: size of the page, for which vertices are rounded and then frames left out.

    Returns:
        Size of the page in bytes.

    Raises:
        InputError: the sample is damaged.
    """
    if folder is None:
        return _write(path, {"title": "No sample was accepted", "lines": []}, b"")
    with Sample(folder) as sample:
        meta = sample.meta  # none of what was not simulated, such as a reconstruction
        if meta is not None and meta["status"] != "accepted":
            title = f"Sample {meta['id']} was {meta['status']}"
            return _write(path, {"title": title, "lines": [meta["reason"]]}, b"")
        lines = [", ".join(sample.garments)] if meta is None else _about(meta)
        header, blob = _encode_within(scene_parts(sample), bytes_max)
        header |= {"title": f"Sample {sample.id}", "lines": lines}
    return _write(path, header, blob)


def write_parts(
    path: str | Path, title: str, lines: Sequence[str], parts: Sequence[ScenePart]
) -> int:
    """Write the page of some parts; those without triangles are points, other ones in every frame.

    Returns:
        Size of the page in bytes.
    """
    header, blob = _encode_within(parts, BYTES_MAX)
    return _write(path, header | {"title": title, "lines": [*lines]}, blob)


def write_side_by_side(
    path: str | Path,
    folders: Mapping[str, str | Path],
    title: str,
    lines: Sequence[str],
    *,
    bytes_max: int = REPORT_BYTES_MAX,
) -> int:
    """Write one page of several samples of the same person in the same motion.

    Args:
        folders: what is said of each sample -> its folder, from left to right; a page without any
            has its words alone.
        title, lines: of the page.
        bytes_max: see `write_viewer`.

    Returns:
        Size of the page in bytes.

    Raises:
        InputError: a sample is damaged, or has another number of frames than the first.
    """
    if not folders:
        return _write(path, {"title": title, "lines": [*lines]}, b"")
    with ExitStack() as opened:
        samples = {name: opened.enter_context(Sample(one)) for name, one in folders.items()}
        scenes = {name: scene_parts(sample) for name, sample in samples.items()}
        counts = {name: len(sample) for name, sample in samples.items()}
        if len(set(counts.values())) > 1:
            told = ", ".join(f"{name} {count}" for name, count in counts.items())
            raise InputError(f"{path}: samples of {told} frames, expected equally many")
        space = _space_m([part for parts in scenes.values() for part in parts])
        middle = (len(scenes) - 1) / 2
        places = {name: (float(k - middle) * space, 0.0) for k, name in enumerate(scenes)}
        parts, stands = [], []
        for name, scene in scenes.items():
            for part in scene:
                if part.name != BODY:
                    parts.append(replace(part, name=f"{part.name} ({name})"))
                    stands.append([places[name]])
                elif BODY not in (one.name for one in parts):  # the same in all of them
                    parts.append(part)
                    stands.append([*places.values()])
        parts = [_coarser(part) for part in parts]
        header, blob = _encode_within(parts, bytes_max, stands)
    labels = [{"text": name, "at": place} for name, place in places.items()]
    return _write(path, header | {"title": title, "lines": [*lines], "labels": labels}, blob)


def _coarser(part: ScenePart) -> ScenePart:
    """A part through some of its vertices, so that a page has room for its frames."""
    faces = part.mesh.triangles
    kept = coarsen_faces(part.mesh.vertices, faces, min(1, _TRIANGLES / max(len(faces), 1)))
    used, corners = np.unique(kept, return_inverse=True)
    mesh = Mesh(part.mesh.vertices[used], corners.reshape(kept.shape).astype(np.int32))
    return replace(
        part, mesh=mesh, read=lambda start, stop: part.read(start, stop)[:, used], texture=None
    )


def _space_m(parts: Sequence[ScenePart]) -> float:
    """Metres between people who stand in a row, so that they keep apart wherever they move."""
    widths = [np.ptp(points[:, 0]) for part in parts for points in part.read(0, part.frame_count)]
    return float(max(widths)) + _APART_M


def _encode_within(
    parts: Sequence[ScenePart],
    bytes_max: int,
    places: Sequence[Sequence[tuple[float, float]]] | None = None,
) -> tuple[dict[str, Any], bytes]:
    """`encode_parts` of as many frames, rounded as finely, as a page of a size can hold."""
    prints = {part.name: _data_url(part.texture) for part in parts if part.texture is not None}
    left, count = bytes_max - _PAGE_BYTES - sum(map(len, prints.values())), parts[0].frame_count
    strides = range(max(1, -(-count // FRAMES_MAX)), count + 1)
    for stride, step in product(strides, STEPS_M):
        header, blob = encode_parts(parts, range(0, count, stride), step, prints)
        if 4 / 3 * len(blob) < left:
            break
    for one, at in zip(header["parts"], places or [], strict=bool(places)):
        one["at"] = at
    return header | {"fps": FPS / stride, "stride": stride}, blob


def encode_parts(
    parts: Sequence[ScenePart],
    frames: Sequence[int],
    step_m: float = STEPS_M[0],
    prints: Mapping[str, str] = MappingProxyType({}),
) -> tuple[dict[str, Any], bytes]:
    """Encode meshes and chosen frames as a header and one compressed block.

    The block holds, part by part, the triangles as uint32; of printed parts, which vertex each of
    the triangles' corners is as uint32, and its texture coordinates as float32; and the vertices as
    16-bit steps from `origin_m`, coded as `encode_frames` says.

    Args:
        frames: which frames to keep, in order.
        prints: data URLs of the pictures on parts, by their names.
        step_m: metres to which vertices are rounded; more for meshes of more than 65,535 steps.

    Returns:
        The header ("origin_m" (3,), "step_m", "frames", "parts") and the block.
    """
    moving = [np.stack([part.read(f, f + 1)[0] for f in frames]) for part in parts]
    origin = np.min([points.min(axis=(0, 1)) for points in moving], axis=0)
    extent = np.max([points.max(axis=(0, 1)) for points in moving], axis=0) - origin
    if not np.isfinite(extent).all():
        raise InputError(f"{parts[0].name}: vertices are not finite, expected metres")
    step = max(step_m, float(extent.max()) / _LEVELS)
    blocks = []
    about = []
    for part, points in zip(parts, moving, strict=True):
        triangles = part.mesh.triangles
        one = {
            "name": part.name,
            "colour": [round(value, 4) for value in part.colour],
            "vertices": points.shape[1],
            "triangles": len(triangles),
        }
        corners = []
        if part.name in prints and part.mesh.uv is not None:
            source, uv, triangles = split_at_seams(part.mesh)
            corners = [source.astype("<u4").tobytes(), np.asarray(uv, "<f4").tobytes()]
            one |= {"corners": len(source), "print": prints[part.name]}
        blocks += [triangles.astype("<u4").tobytes(), *corners]
        steps = np.rint((points - origin) / step).astype(np.uint16)
        blocks.append(encode_frames(steps))
        about.append(one)
    header = {
        "origin_m": [float(value) for value in origin],
        "step_m": step,
        "frames": len(frames),
        "parts": about,
    }
    return header, zlib.compress(b"".join(blocks), 9)


def _data_url(path: Path) -> str:
    """A data URL of a picture with few pixels and colours."""
    picture = Image.fromarray(halved_picture(path)).quantize(_PRINT_COLOURS)
    stream = io.BytesIO()
    picture.save(stream, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode()


def encode_frames(steps: np.ndarray) -> bytes:
    """Encode 16-bit positions in a form that compresses well.

    Every value is replaced by its difference to the frame before, and that by its difference to
    the vertex before (both modulo 2^16, so nothing is lost); signs are moved to the lowest bit;
    low bytes come first, then high bytes.

    Args:
        steps: (N, V, 3) uint16.
    """
    change = np.diff(steps, axis=0, prepend=np.zeros_like(steps[:1]))
    change = np.diff(change, axis=1, prepend=np.zeros_like(change[:, :1])).view(np.int16)
    folded = ((change << 1) ^ (change >> 15)).view(np.uint16)
    planes = np.stack([folded & 0xFF, folded >> 8]).astype(np.uint8)
    # One coordinate after the other, because they are more alike than neighbours in a vertex.
    return np.ascontiguousarray(planes.transpose(0, 1, 3, 2)).tobytes()


def _about(meta: dict[str, Any]) -> list[str]:
    worn = ", ".join(f"{g['name']} of {g['fabric']}" for g in meta["outfit"]["garments"])
    motion = meta["motion"]
    return [
        worn,
        f"{meta['body']['gender']} body, {motion['action'] or 'no action label'}"
        f" ({motion['sequence']}), {motion['frames']} frames, {meta['split']} split",
    ]


def _write(path: str | Path, header: dict[str, Any], blob: bytes) -> int:
    template = Path(__file__).with_name("viewer.html").read_text()
    # "</" would end the script element that holds the header, "<!--<script>" keep it open.
    text = json.dumps(header, allow_nan=False).replace("<", "\\u003c")
    page = (
        template.replace("{{title}}", escape(header["title"]))
        .replace("{{header}}", text)
        .replace("{{data}}", base64.b64encode(blob).decode())
    )
    with atomic_file(path) as scratch:
        scratch.write_text(page)
    return len(page.encode())
