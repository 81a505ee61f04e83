"""Pictures in rows with titles, colours for errors, cards, and small moving pictures."""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from scipy.spatial import cKDTree

from drapeline.rendering.raytracer import ColouredMesh
from drapeline.storage import atomic_file

_HEAT_LEVELS = 40
_INK, _QUIET, _PAPER = (34, 34, 34), (107, 111, 118), (255, 255, 255)
_CARD = (237, 238, 240)
_Font: TypeAlias = ImageFont.ImageFont | ImageFont.FreeTypeFont
# PNG is shown by a Snakemake report; WebP, in full colour, is smaller still.
_FORMATS: dict[str, dict[str, Any]] = {
    ".png": {"format": "PNG"},
    ".webp": {"format": "WEBP", "quality": 85, "method": 6},
}
_COLOURS = 256
# Steps between the palest ones, and to white, would be seen where shadows fade out.
_PALE = np.repeat(np.arange(225, 256, 2, dtype=np.uint8)[:, None], 3, axis=1)
_LEVELS = 128  # of red, green and blue, between which pixels of a PNG are not told apart
_SAMPLE = 500_000  # pixels, most of them white, that decide which colours there are


def heat_colour(share: np.ndarray | float) -> np.ndarray:
    """(..., 3) sRGB in 0-1: dark blue for 0, yellow for 1 and more."""
    import matplotlib  # here, because few pictures have such colours

    heat = matplotlib.colormaps["viridis"]
    return np.asarray(heat(np.clip(np.asarray(share, dtype=float), 0, 1)))[..., :3]


def heat_parts(
    vertices: np.ndarray, faces: np.ndarray, error_mm: np.ndarray, span_mm: float
) -> list[ColouredMesh]:
    """A garment (V, 3) coloured by the errors (F,) of its faces, 0 to `span_mm`.

    They are bands of faces with similar errors, because a `ColouredMesh` has one colour.
    """
    share = np.clip(error_mm / span_mm, 0, 1)
    level = np.minimum((share * _HEAT_LEVELS).astype(int), _HEAT_LEVELS - 1)
    return [
        ColouredMesh(vertices, faces[level == k], heat_colour((k + 0.5) / _HEAT_LEVELS))
        for k in np.unique(level)
    ]


class GridCell(NamedTuple):
    """A picture (H, W, 3) uint8 with its caption, which may be empty."""

    picture: np.ndarray
    caption: str = ""


def save_grid(
    path: str | Path,
    rows: Sequence[Sequence[GridCell | None]],
    *,
    columns: Sequence[str] = (),
    labels: Sequence[str] = (),
    heat_mm: float | None = None,
) -> None:
    """Write a PNG of pictures in rows: titles above, labels to the left, captions at the bottom.

    Args:
        rows: cells whose pictures are of one size; None leaves a place empty.
        columns: titles, which may have several lines.
        labels: of the rows, which may have several lines.
        heat_mm: span of the colour bar of `heat_parts` at the bottom; None for no bar.
    """
    letter, gap = 15, 6
    font, small = ImageFont.load_default(letter), ImageFont.load_default(letter - 1)
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
            draw.multiline_text((gap, y + 0.4 * height), labels[row], _INK, font=font, spacing=3)
    if heat_mm:
        _draw_heat_bar(sheet, draw, left, size[1] + gap, font, heat_mm)
    save_picture(path, np.asarray(sheet))


def save_contact_sheet(
    path: str | Path, pictures: Sequence[tuple[np.ndarray, str]], columns: int, *, letter: int = 14
) -> None:
    """Write a PNG of pictures that fill rows one after the other, each above its caption.

    Captions have as many lines as it takes for them to be no wider than the pictures.

    Args:
        pictures: (H, W, 3) uint8, of any sizes, and their captions.
        columns: pictures in a row.
        letter: height of the captions, in pixels.
    """
    gap = 8
    width = max(p.shape[1] for p, _ in pictures)
    height = max(p.shape[0] for p, _ in pictures)
    rows = -(-len(pictures) // columns)
    font = ImageFont.load_default(letter)
    captions = [_in_lines(caption, font, width) for _, caption in pictures]
    below = round((1.25 * max(caption.count("\n") + 1 for caption in captions) + 0.45) * letter)
    sheet = Image.new(
        "RGB", (columns * (width + gap) + gap, rows * (height + below + gap) + gap), _PAPER
    )
    draw = ImageDraw.Draw(sheet)
    for index, ((picture, _), caption) in enumerate(zip(pictures, captions, strict=True)):
        row, column = divmod(index, columns)
        x, y = gap + column * (width + gap), gap + row * (height + below + gap)
        sheet.paste(Image.fromarray(picture), (x, y))
        place = (x + 2, y + height + 0.2 * letter)
        draw.multiline_text(place, caption, _INK, font=font, spacing=2)
    save_picture(path, np.asarray(sheet))


def _in_lines(text: str, font: _Font, width: int) -> str:
    """The words of a text in lines of this many pixels; a longer word has a line of its own."""
    first, *words = text.split(" ")
    lines = [first]
    for word in words:
        longer = f"{lines[-1]} {word}"
        if font.getlength(longer) <= width:
            lines[-1] = longer
        else:
            lines.append(word)
    return "\n".join(lines)


def join_pictures(pictures: Sequence[np.ndarray], titles: Sequence[str]) -> np.ndarray:
    """Pictures (H, W, 3) side by side under their titles."""
    font, top = ImageFont.load_default(16), 24
    row = np.concatenate(pictures, axis=1)
    image = Image.new("RGB", (row.shape[1], row.shape[0] + top), _PAPER)
    image.paste(Image.fromarray(row), (0, top))
    draw = ImageDraw.Draw(image)
    for index, title in enumerate(titles):
        draw.text((index * pictures[0].shape[1] + 5, 4), title, _INK, font=font)
    return np.asarray(image)


def text_card(title: str, text: str, size: tuple[int, int]) -> np.ndarray:
    """A plain picture (H, W, 3) uint8 of a title and a text, for one that could not be taken.

    Args:
        title: one line.
        text: wrapped to the picture's width; what does not fit is cut off.
        size: width and height in pixels.
    """
    width, height = size
    image = Image.new("RGB", size, _CARD)
    draw = ImageDraw.Draw(image)
    margin, letter = width // 12, max(14, width // 26)
    small = ImageFont.load_default(letter)
    columns = int((width - 2 * margin) / (0.52 * letter))
    draw.text((margin, height * 0.36), title, _INK, font=ImageFont.load_default(letter * 1.6))
    top = height * 0.36 + 2.6 * letter
    fitting = int((height - top - margin) / (1.45 * letter))
    lines = "\n".join(textwrap.wrap(text, columns)[:fitting])
    draw.text((margin, top), lines, _QUIET, font=small)
    return np.asarray(image)


def _draw_heat_bar(
    sheet: Image.Image,
    draw: ImageDraw.ImageDraw,
    left: int,
    top: int,
    font: _Font,
    span_mm: float,
) -> None:
    """Draw the scale of `heat_parts`, from 0 to `span_mm`."""
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


def save_picture(path: str | Path, picture: np.ndarray) -> None:
    """Write a PNG of a picture (H, W, 3) uint8 in the 256 colours that it needs most.

    It has two fifths of the size that it would have in full colour.
    """
    (indexed,) = _indexed(picture[None])
    with atomic_file(path) as scratch:
        indexed.save(scratch, format="PNG", optimize=True)


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
