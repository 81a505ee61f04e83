"""Sheets of pictures in rows, and colours for errors."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from drapeline.rendering.raytracer import ColouredMesh
from drapeline.storage import atomic_file

_HEAT = matplotlib.colormaps["viridis"]
_HEAT_LEVELS = 40
_INK, _QUIET, _PAPER = (34, 34, 34), (107, 111, 118), (255, 255, 255)


def heat_colour(share: np.ndarray | float) -> np.ndarray:
    """(..., 3) sRGB in 0-1: dark blue for 0, yellow for 1 and more."""
    return np.asarray(_HEAT(np.clip(np.asarray(share, dtype=float), 0, 1)))[..., :3]


def heat_parts(
    vertices: np.ndarray, faces: np.ndarray, error_mm: np.ndarray, span_mm: float
) -> list[ColouredMesh]:
    """A garment (V, 3) coloured by the errors (F,) of its faces, 0 to `span_mm`.

    It comes in bands of faces with similar errors, for the studio paints a mesh in one colour.
    """
    share = np.clip(error_mm / span_mm, 0, 1)
    level = np.minimum((share * _HEAT_LEVELS).astype(int), _HEAT_LEVELS - 1)
    return [
        ColouredMesh(vertices, faces[level == k], heat_colour((k + 0.5) / _HEAT_LEVELS))
        for k in np.unique(level)
    ]


class Cell(NamedTuple):
    """A picture (H, W, 3) of a sheet with its caption, which may be empty."""

    picture: np.ndarray
    caption: str = ""


def save_sheet(
    path: str | Path,
    rows: Sequence[Sequence[Cell | None]],
    *,
    columns: Sequence[str] = (),
    labels: Sequence[str] = (),
    heat_mm: float | None = None,
    letter: int = 15,
    gap: int = 6,
) -> None:
    """Write a PNG of pictures in rows, titles above, labels to the left, captions in their feet.

    Args:
        path: the PNG.
        rows: of cells with pictures of one size; None leaves a place empty.
        columns: titles; a newline breaks the line.
        labels: of the rows; a newline breaks the line.
        heat_mm: span of the colour bar of `heat_parts` below; without one if None.
        letter: height of the letters in pixels.
        gap: between pictures.
    """
    font, small = ImageFont.load_default(letter), ImageFont.load_default(letter - 2)
    height, width = next(c.picture for row in rows for c in row if c is not None).shape[:2]
    words = [line for label in labels for line in label.splitlines()]
    left = gap + (round(max(map(font.getlength, words))) + 2 * gap if words else 0)
    lines = max((title.count("\n") + 1 for title in columns), default=0)
    top = gap + (round((1.25 * lines + 0.35) * letter) if lines else 0)
    count = max(map(len, rows))
    size = (left + count * (width + gap), top + len(rows) * (height + gap))
    bar = round(4.2 * letter) if heat_mm else 0
    sheet = Image.new("RGB", (size[0], size[1] + bar), _PAPER)
    draw = ImageDraw.Draw(sheet)
    for column, title in enumerate(columns):
        place = (left + column * (width + gap) + 2, gap)
        draw.multiline_text(place, title, _INK, font=font, spacing=2)
    for row, cells in enumerate(rows):
        y = top + row * (height + gap)
        for column, cell in enumerate(cells):
            if cell is None:
                continue
            x = left + column * (width + gap)
            sheet.paste(Image.fromarray(cell.picture), (x, y))
            draw.text((x + 6, y + height - 5), cell.caption, _INK, font=small, anchor="ls")
        if row < len(labels):
            place = (gap, y + 0.4 * height)
            draw.multiline_text(place, labels[row], _INK, font=font, spacing=3)
    if heat_mm:
        _draw_heat_bar(sheet, draw, left, size[1] + gap, font, heat_mm)
    with atomic_file(path) as scratch:
        sheet.save(scratch, format="PNG", optimize=True)


def _draw_heat_bar(
    sheet: Image.Image,
    draw: ImageDraw.ImageDraw,
    left: int,
    top: int,
    font: ImageFont.ImageFont,
    span_mm: float,
) -> None:
    """Draw what the colours of `heat_parts` mean, up to `span_mm`, on a sheet."""
    width, thick = min(420, sheet.width - left - 70), 16
    colours = heat_colour(np.linspace(0, 1, width))
    bar = np.repeat(np.round(255 * colours).astype(np.uint8)[None], thick, axis=0)
    sheet.paste(Image.fromarray(bar), (left, top))
    for share in (0, 0.2, 0.4, 0.6, 0.8, 1):
        text = f"{share * span_mm:.0f}" + (" mm or more" if share == 1 else "")
        x = left + share * (width - 1)
        draw.line((x, top + thick, x, top + thick + 4), fill=_QUIET)
        start = x if share == 1 else x - font.getlength(text) / 2
        draw.text((max(left, start), top + thick + 6), text, _INK, font=font)
