"""Animated PNGs, small enough for a report with many of them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from drapeline.storage import atomic_file

_COLOURS = 96


def save_animation(path: str | Path, pictures: Sequence[np.ndarray], frame_ms: int) -> None:
    """Write an endless animated PNG of pictures (H, W, 3) uint8 of one size.

    Args:
        path: the PNG.
        pictures: reduced to a palette of 96 colours.
        frame_ms: time that each is shown, in milliseconds.
    """
    # One palette for all pictures: with one each, the colours would flicker.
    sheet = Image.fromarray(np.concatenate(pictures[:: max(1, len(pictures) // 6)]))
    palette = sheet.quantize(_COLOURS, method=Image.Quantize.MEDIANCUT)
    images = [
        Image.fromarray(p).quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures
    ]
    with atomic_file(path) as scratch:
        images[0].save(
            scratch,
            format="PNG",
            save_all=True,
            append_images=images[1:],
            duration=frame_ms,
            loop=0,
            optimize=True,
        )
