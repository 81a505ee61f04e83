"""Moving pictures that are small enough to be many."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial import cKDTree

from drapeline.storage import atomic_file

# PNG is shown by a Snakemake report; WebP, in full colour, is smaller still.
_FORMATS = {
    ".png": {"format": "PNG"},
    ".webp": {"format": "WEBP", "quality": 85, "method": 6},
}
_COLOURS = 256
# Steps between the palest ones, and to white, would be seen where shadows fade out.
_PALE = np.repeat(np.arange(225, 256, 2, dtype=np.uint8)[:, None], 3, axis=1)
_LEVELS = 128  # of red, green and blue, between which pixels of a PNG are not told apart
_SAMPLE = 500_000  # pixels, most of them white, that decide which colours there are


def save_animation(path: str | Path, pictures: Sequence[np.ndarray], frame_ms: float) -> None:
    """Write an endless animation of pictures (H, W, 3) uint8 of one size.

    A PNG has 256 colours, those that its pictures need most, and less than half the size that it
    would have in full colour. Nothing is dithered.

    Args:
        path: `.png` or `.webp`.
        pictures: are shown one after the other.
        frame_ms: time that each is shown, in milliseconds, rounded to whole ones.
    """
    suffix = Path(path).suffix
    first, *others = (
        _indexed(np.stack(pictures)) if suffix == ".png" else map(Image.fromarray, pictures)
    )
    with atomic_file(path) as scratch:
        first.save(
            scratch,
            save_all=True,
            append_images=others,
            duration=round(frame_ms),
            loop=0,
            **_FORMATS[suffix],
        )


def _indexed(pictures: np.ndarray) -> list[Image.Image]:
    """Pictures (F, H, W, 3) in colours of one palette, each pixel in the nearest one."""
    palette = _palette(pictures.reshape(-1, 3))
    cells = np.zeros(pictures.shape[:3], dtype=np.int32)
    for channel in range(3):
        cells = cells * _LEVELS + pictures[..., channel] // (256 // _LEVELS)
    used = np.flatnonzero(np.bincount(cells.ravel(), minlength=_LEVELS**3))
    levels = np.stack(np.unravel_index(used, (_LEVELS,) * 3), axis=1)
    nearest = np.zeros(_LEVELS**3, dtype=np.uint8)
    nearest[used] = cKDTree(palette).query(levels * (255 / (_LEVELS - 1)))[1]
    frames = [Image.fromarray(indices, mode="P") for indices in nearest[cells]]
    for frame in frames:
        frame.putpalette(palette.tobytes())
    return frames


def _palette(pixels: np.ndarray) -> np.ndarray:
    """(at most 256, 3) uint8: pale greys, and colours that stand for the other pixels (N, 3)."""
    sample = pixels[:: max(1, len(pixels) // _SAMPLE)]
    pale = (sample >= _PALE.min()).all(axis=1) & (np.ptp(sample, axis=1) <= 2)
    sample = sample[~pale]
    if not len(sample):
        return _PALE
    reduced = Image.fromarray(sample[None]).quantize(
        _COLOURS - len(_PALE), method=Image.Quantize.MEDIANCUT, kmeans=3
    )
    found = np.array(reduced.getpalette(), dtype=np.uint8).reshape(-1, 3)
    return np.concatenate([_PALE, found[: _COLOURS - len(_PALE)]])
