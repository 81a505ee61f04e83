"""Cards and grids of pictures with captions, drawn by Pillow."""

import textwrap
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from drapeline.storage import atomic_file

_INK, _QUIET, _PAPER = (34, 34, 34), (107, 111, 118), (255, 255, 255)
_CARD = (237, 238, 240)


def text_card(title: str, text: str, size: tuple[int, int]) -> np.ndarray:
    """A plain picture with a title and a text, where there is nothing to show.

    Args:
        title: one line.
        text: wrapped to the picture's width; what does not fit is cut off.
        size: width and height in pixels.

    Returns:
        (height, width, 3) uint8.
    """
    width, height = size
    image = Image.new("RGB", size, _CARD)
    draw = ImageDraw.Draw(image)
    margin, letter = width // 12, max(11, width // 26)
    small = ImageFont.load_default(letter)
    columns = int((width - 2 * margin) / (0.52 * letter))
    draw.text((margin, height * 0.36), title, _INK, font=ImageFont.load_default(letter * 1.6))
    lines = "\n".join(textwrap.wrap(text, columns)[:10])
    draw.text((margin, height * 0.36 + 2.6 * letter), lines, _QUIET, font=small)
    return np.asarray(image)


def contact_sheet(
    path: str | Path,
    pictures: Sequence[tuple[np.ndarray, str]],
    columns: int,
    *,
    gap: int = 8,
    letter: int = 14,
) -> None:
    """Write a PNG with pictures in rows, each with its caption below it.

    Args:
        path: the PNG.
        pictures: (H, W, 3) uint8, of any sizes, and their captions.
        columns: pictures in a row.
        gap: between pictures, in pixels.
        letter: height of the captions, in pixels.
    """
    width = max(p.shape[1] for p, _ in pictures)
    height = max(p.shape[0] for p, _ in pictures)
    rows = -(-len(pictures) // columns)
    below = round(1.7 * letter)
    sheet = Image.new(
        "RGB",
        (columns * (width + gap) + gap, rows * (height + below + gap) + gap),
        _PAPER,
    )
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(letter)
    for index, (picture, caption) in enumerate(pictures):
        row, column = divmod(index, columns)
        x, y = gap + column * (width + gap), gap + row * (height + below + gap)
        sheet.paste(Image.fromarray(picture), (x, y))
        draw.text((x + 2, y + height + 0.2 * letter), caption, _INK, font=font)
    with atomic_file(path) as scratch:
        sheet.save(scratch, format="PNG", optimize=True)
