"""Pictures of prints."""

from functools import lru_cache
from pathlib import Path

import numpy as np
from PIL import Image

from drapeline.errors import DamagedFile, refuse_damage

_LARGEST_PX = 8192


def read_picture(path: Path) -> np.ndarray:
    """A picture (H, W, 3) uint8 sRGB.

    Raises:
        DamagedFile: it is no picture, cut off, or larger than 8192 pixels.
        InputError: the system does not let it be read.
    """
    with refuse_damage(path, "a picture"), Image.open(path) as image:
        if max(image.size) > _LARGEST_PX:
            raise DamagedFile(
                path, f"is of {image.size} pixels, expected {_LARGEST_PX} each way at most"
            )
        return np.asarray(image.convert("RGB"))


def halved_picture(path: Path) -> np.ndarray:
    """A picture with half as many pixels each way, which are finer than any view that shows it.

    It is read once for all frames, unless the file has changed.

    Raises:
        DamagedFile, InputError: see `read_picture`.
    """
    about = path.stat()
    return _halved(path, about.st_mtime_ns, about.st_size)


@lru_cache(maxsize=16)
def _halved(path: Path, *_state: int) -> np.ndarray:
    picture = read_picture(path)
    height, width = (side // 2 for side in picture.shape[:2])
    if min(height, width) < 2:
        return picture
    blocks = picture[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 3)
    return blocks.mean(axis=(1, 3)).astype(np.uint8)
