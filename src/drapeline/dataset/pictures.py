"""Pictures of prints."""

from pathlib import Path

import numpy as np
from PIL import Image, UnidentifiedImageError

from drapeline.errors import DamagedFile

_LARGEST_PX = 8192


def read_picture(path: Path) -> np.ndarray:
    """A picture (H, W, 3) uint8 sRGB.

    Raises:
        DamagedFile: it is no picture, cut off, or larger than 8192 pixels.
    """
    try:
        with Image.open(path) as image:
            if max(image.size) > _LARGEST_PX:
                raise DamagedFile(
                    path, f"is of {image.size} pixels, expected {_LARGEST_PX} at most"
                )
            return np.asarray(image.convert("RGB"))
    except (UnidentifiedImageError, ValueError, SyntaxError, OSError) as error:
        raise DamagedFile(path, f"cannot be read as a picture ({error})") from error


def mean_colour(path: Path) -> tuple[float, float, float]:
    """The mean of a picture, sRGB in 0-1.

    Raises:
        DamagedFile: see `read_picture`.
    """
    red, green, blue = (read_picture(path)[::8, ::8].reshape(-1, 3).mean(axis=0) / 255).tolist()
    return red, green, blue
