"""Moving pictures in full colour."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from drapeline.storage import atomic_file

# PNG loses nothing and is shown by a Snakemake report; WebP is a sixth of its size.
_FORMATS = {
    ".png": {"format": "PNG"},
    ".webp": {"format": "WEBP", "quality": 85, "method": 6},
}


def save_animation(path: str | Path, pictures: Sequence[np.ndarray], frame_ms: float) -> None:
    """Write an endless animation of pictures (H, W, 3) uint8 of one size.

    Args:
        path: `.png` or `.webp`.
        pictures: are shown one after the other.
        frame_ms: time that each is shown, in milliseconds, rounded to whole ones.
    """
    first, *others = map(Image.fromarray, pictures)
    with atomic_file(path) as scratch:
        first.save(
            scratch,
            save_all=True,
            append_images=others,
            duration=round(frame_ms),
            loop=0,
            **_FORMATS[Path(path).suffix],
        )
