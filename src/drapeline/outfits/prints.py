"""Prints and weaves of cloth: which a garment has, and its picture on the garment's texture map."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from drapeline.geometry.mesh import triangulate
from drapeline.seeding import rng_for

TEXTURE_PX = 2048  # width and height of the pictures, CLOTH3D's
_WHITE, _NAVY, _BLACK = (0.95, 0.94, 0.91), (0.1, 0.13, 0.25), (0.09, 0.09, 0.1)
_INDIGO = ((0.16, 0.22, 0.36), (0.24, 0.31, 0.45), (0.42, 0.5, 0.62), (0.13, 0.14, 0.17))
Colour = Sequence[float]  # sRGB in 0-1


class _Choice(NamedTuple):
    kind: str
    chance: float
    size_m: tuple[float, float] = (0.0, 0.0)  # of its repeat


# What cloth of a fabric looks like.
_CHOICES: dict[str, tuple[_Choice, ...]] = {
    "cotton": (
        _Choice("plain", 0.25),
        _Choice("stripes", 0.15, (0.012, 0.05)),
        _Choice("pinstripe", 0.1, (0.012, 0.03)),
        _Choice("gingham", 0.15, (0.01, 0.03)),
        _Choice("tartan", 0.15, (0.09, 0.16)),
        _Choice("dots", 0.1, (0.02, 0.045)),
        _Choice("flowers", 0.1, (0.05, 0.1)),
    ),
    "linen": (
        _Choice("slub", 0.5, (0.0022, 0.0035)),
        _Choice("stripes", 0.2, (0.02, 0.05)),
        _Choice("gingham", 0.15, (0.012, 0.03)),
        _Choice("plain", 0.15),
    ),
    "denim": (_Choice("twill", 1.0, (0.0028, 0.0036)),),
    "silk": (
        _Choice("plain", 0.4),
        _Choice("dots", 0.2, (0.018, 0.04)),
        _Choice("flowers", 0.25, (0.06, 0.14)),
        _Choice("stripes", 0.15, (0.02, 0.08)),
    ),
    "satin": (
        _Choice("plain", 0.7),
        _Choice("stripes", 0.15, (0.02, 0.06)),
        _Choice("flowers", 0.15, (0.08, 0.16)),
    ),
    "wool_suiting": (
        _Choice("herringbone", 0.25, (0.02, 0.032)),
        _Choice("pinstripe", 0.25, (0.012, 0.025)),
        _Choice("houndstooth", 0.15, (0.016, 0.04)),
        _Choice("tartan", 0.15, (0.12, 0.2)),
        _Choice("plain", 0.2),
    ),
    "jersey": (
        _Choice("knit", 0.45, (0.003, 0.005)),
        _Choice("breton", 0.3, (0.02, 0.05)),
        _Choice("plain", 0.25),
    ),
    "fleece": (_Choice("plain", 0.75), _Choice("tartan", 0.25, (0.12, 0.2))),
}


def draw_texture(seed: int, fabric: str, colour: Colour) -> dict[str, Any]:
    """Draw what cloth of a fabric looks like: `Garment.attributes["texture"]`.

    Args:
        seed: of the garment.
        fabric: its name.
        colour: that the garment has if it is plain, and most of it otherwise.

    Returns:
        `type`: "pattern"; `print`: what `draw_print` takes; `data`: the colour of most of it.
    """
    rng = rng_for(seed, "print")
    choices = _CHOICES.get(fabric, (_Choice("plain", 1.0),))
    chances = np.array([choice.chance for choice in choices])
    chosen = choices[int(rng.choice(len(choices), p=chances / chances.sum()))]
    ground = list(map(float, colour))
    if fabric == "denim":
        ground = list(_INDIGO[int(rng.integers(len(_INDIGO)))])
    if fabric == "wool_suiting":
        ground = [float(0.25 * c + 0.75 * 0.6 * np.mean(ground)) for c in ground]  # muted
    return {
        "type": "pattern",
        "data": ground,
        "print": {
            "kind": chosen.kind,
            "size_m": float(rng.uniform(*chosen.size_m)),
            "colours": [ground, *_companions(rng, ground)],
            "seed": int(rng.integers(2**31)),
        },
    }


def _companions(rng: np.random.Generator, ground: Colour) -> list[list[float]]:
    """Two colours that are seen on a ground: one far from it, and one beside."""
    dark = np.mean(ground) < 0.45
    far = _WHITE if dark else (_NAVY, _BLACK, _WHITE)[int(rng.integers(3))]
    if not dark and np.abs(np.subtract(far, ground)).mean() < 0.2:
        far = _NAVY
    beside = np.roll(ground, 1 + int(rng.integers(2))) * rng.uniform(0.6, 1.2)
    return [list(map(float, far)), np.clip(beside, 0.05, 0.95).astype(float).tolist()]


def metres_per_unit(
    vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray, uv_faces: np.ndarray
) -> float:
    """How long a side of the unit square of texture coordinates is on a garment, in metres."""
    corners, places = vertices[triangulate(faces)], uv[triangulate(uv_faces)]
    long = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    flat = np.linalg.norm(places - np.roll(places, 1, axis=1), axis=2)
    return float(np.median(long[flat > 0] / flat[flat > 0]))


def draw_print(about: Mapping[str, Any], side_m: float, size: int = TEXTURE_PX) -> np.ndarray:
    """(size, size, 3) uint8 sRGB of a print on the unit square of texture coordinates.

    Args:
        about: `print` of `draw_texture`.
        side_m: as `metres_per_unit` gives it.
        size: pixels.
    """
    colours = np.array(about["colours"], dtype=np.float64)
    drawn = _KINDS[about["kind"]](colours, about["size_m"], rng_for(about["seed"], "picture"))
    wide, high = (max(1, round(length * size / side_m)) for length in drawn.repeat_m)
    width, height = min(wide, size), min(high, size)
    # Edges are smooth by pixels that are thinner, and brought together again.
    x = (np.arange(_FINE * width) + 0.5) / (_FINE * wide) * drawn.repeat_m[0]
    y = (np.arange(_FINE * height) + 0.5)[::-1] / (_FINE * high) * drawn.repeat_m[1]
    palette = np.clip(drawn.palette, 0, 1).astype(np.float32)
    tile = np.zeros((height, width, 3), np.uint8)
    for first in range(0, height, _ROWS):
        part = y[_FINE * first : _FINE * (first + _ROWS), None]
        pixels = palette[drawn.number_at(x[None], part)]
        pixels = pixels.reshape(-1, _FINE, width, _FINE, 3).mean(axis=(1, 3))
        tile[first : first + _ROWS] = np.round(255 * pixels)
    return np.tile(tile, (-(-size // height), -(-size // width), 1))[-size:, :size]


_FINE, _ROWS = 3, 64  # of pixels; rows that are drawn at once


class _Drawn(NamedTuple):
    """One repeat of a print."""

    palette: np.ndarray  # (K, 3)
    repeat_m: tuple[float, float]  # across and up
    # (x (1, W), y (H, 1) in metres) -> numbers of colours (H, W)
    number_at: Callable[[np.ndarray, np.ndarray], np.ndarray]


def _part(length: np.ndarray, repeat: float) -> np.ndarray:
    """Where in a repeat a length is, in 0-1."""
    return np.mod(length / repeat, 1.0)


def _flat(values: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Values that are the same along x or y, everywhere."""
    return np.broadcast_to(values, np.broadcast_shapes(x.shape, y.shape))


def _stripes(colours: np.ndarray, size_m: float, rng: np.random.Generator) -> _Drawn:
    """Bands along the warp, one or two of them in a repeat."""
    wide = float(rng.uniform(0.35, 0.6))
    order, ends = [0, 1], [wide]
    if rng.random() < 0.5:
        middle = (1 + wide) / 2
        order, ends = [0, 1, 2, 1], [wide, middle - 0.04, middle + 0.04]
    number = np.array(order)
    return _Drawn(
        colours,
        (size_m, size_m),
        lambda x, y: _flat(number[np.searchsorted(ends, _part(x, size_m))], x, y),
    )


def _pinstripe(colours: np.ndarray, size_m: float, rng: np.random.Generator) -> _Drawn:
    return _Drawn(colours, (size_m, size_m), lambda x, y: _flat((x < _LINE_M).astype(int), x, y))


def _breton(colours: np.ndarray, size_m: float, rng: np.random.Generator) -> _Drawn:
    """Bands around the body."""
    wide = float(rng.uniform(0.3, 0.5)) * size_m
    return _Drawn(colours, (size_m, size_m), lambda x, y: _flat((y < wide).astype(int), x, y))


def _gingham(colours: np.ndarray, size_m: float, rng: np.random.Generator) -> _Drawn:
    palette = np.stack([colours[0], (colours[0] + colours[1]) / 2, colours[1]])
    return _Drawn(
        palette,
        (2 * size_m, 2 * size_m),
        lambda x, y: (x < size_m).astype(int) + (y < size_m),
    )


def _tartan(colours: np.ndarray, size_m: float, rng: np.random.Generator) -> _Drawn:
    """A sequence of bands there and back, the same along the warp and the weft."""
    widths = rng.uniform(0.04, 0.3, 6)
    ends = np.cumsum(widths / widths.sum())
    order = np.array([0, 1, 0, 2, 0, int(rng.integers(1, 3))])
    palette = (colours[:, None] + colours[None]).reshape(-1, 3) / 2

    def band(length: np.ndarray) -> np.ndarray:
        place = 1 - np.abs(2 * _part(length, size_m) - 1)
        return order[np.searchsorted(ends, place).clip(max=len(order) - 1)]

    return _Drawn(palette, (size_m, size_m), lambda x, y: len(colours) * band(x) + band(y))


def _dots(colours: np.ndarray, size_m: float, rng: np.random.Generator) -> _Drawn:
    radius = float(rng.uniform(0.15, 0.3)) * size_m

    def dot(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        _, dx, dy = _lattice(x, y, size_m)
        return (dx * dx + dy * dy < radius * radius).astype(int)

    return _Drawn(colours, (size_m, 2 * size_m), dot)


def _lattice(
    x: np.ndarray, y: np.ndarray, step_m: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cells of staggered rows: their numbers, and the way (dx, dy) from their middles."""
    row = np.floor(y / step_m)
    shifted = x + 0.5 * step_m * np.mod(row, 2)
    column = np.floor(shifted / step_m)
    dx, dy = shifted - (column + 0.5) * step_m, y - (row + 0.5) * step_m + 0 * x
    return (column + 3 * row).astype(int), dx, dy


def _flowers(colours: np.ndarray, size_m: float, rng: np.random.Generator) -> _Drawn:
    """Blossoms of five or six petals, each of four turned and placed a little otherwise."""
    kinds = 4
    turn, shift = rng.uniform(0, 6.3, kinds), rng.uniform(-0.12, 0.12, (2, kinds)) * size_m
    petals = int(rng.integers(5, 7))
    leaf = 0.5 * colours[0] + 0.5 * np.array([0.25, 0.45, 0.25])
    palette = np.concatenate([colours, leaf[None]])

    def flower(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        cell, dx, dy = _lattice(x, y, size_m)
        kind = np.mod(cell, kinds)
        dx, dy = dx - shift[0, kind], dy - shift[1, kind]
        radius, angle = np.hypot(dx, dy) / size_m, np.arctan2(dy, dx) + turn[kind]
        edge = 0.16 + 0.1 * np.abs(np.cos(0.5 * petals * angle))
        leaves = (radius < 0.34) & (np.abs(np.sin(angle)) < 1.8 * (0.4 - radius))
        number = np.where(leaves, 3, 0)
        number = np.where(radius < edge, 1, number)
        return np.where(radius < 0.07, 2, number)

    return _Drawn(palette, (kinds * size_m, kinds * size_m), flower)


def _herringbone(colours: np.ndarray, size_m: float, rng: np.random.Generator) -> _Drawn:
    palette = np.stack([colours[0], _shade(colours[0], 1.4)])

    def bone(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        side = np.where(x < size_m, 1.0, -1.0)
        return (_part(y + side * x, size_m / 4) < 0.5).astype(int)

    return _Drawn(palette, (2 * size_m, size_m / 4), bone)


def _houndstooth(colours: np.ndarray, size_m: float, rng: np.random.Generator) -> _Drawn:
    """Four dark and four light threads either way, in a twill of two over two."""

    def tooth(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        warp, weft = (np.floor(8 * _part(length, size_m)).astype(int) for length in (x, y))
        return np.where(np.mod(warp - weft, 4) < 2, warp < 4, weft < 4).astype(int)

    return _Drawn(colours, (size_m, size_m), tooth)


def _twill(colours: np.ndarray, size_m: float, rng: np.random.Generator) -> _Drawn:
    """Denim: pale weft shows between diagonals of blue warp, whose threads are uneven."""
    pale = 0.55 * colours[0] + 0.45 * np.array([0.8, 0.82, 0.84])
    tones = 1 + 0.1 * np.linspace(-1, 1, _TONES)
    palette = np.concatenate([np.outer(tones, colours[0]), np.outer(tones, pale)])
    thread = _threads(rng)
    return _Drawn(
        palette,
        (_THREADS * size_m / 3, size_m),
        lambda x, y: thread(x, size_m / 3) + _TONES * (_part(x + y, size_m) > 0.68).astype(int),
    )


def _slub(colours: np.ndarray, size_m: float, rng: np.random.Generator) -> _Drawn:
    """Linen: threads of uneven thickness, along the warp and the weft."""
    tones = 1 + 0.09 * np.linspace(-1, 1, _TONES)
    palette = (tones[:, None] + tones[None]).reshape(-1, 1) / 2 * colours[0]
    warp, weft = _threads(rng), _threads(rng)
    side = _THREADS * size_m / 2
    return _Drawn(
        palette,
        (side, side),
        lambda x, y: _TONES * warp(x, size_m / 2) + weft(y, size_m / 2),
    )


def _knit(colours: np.ndarray, size_m: float, rng: np.random.Generator) -> _Drawn:
    """Wales of loops."""
    palette = np.stack([colours[0], _shade(colours[0], 0.88), _shade(colours[0], 0.76)])
    course_m = 0.8 * size_m

    def loop(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        across = np.abs(2 * _part(x, size_m) - 1)
        course = _part(y + 0.6 * course_m * across, course_m) > 0.7
        return np.where(across > 0.85, 2, course.astype(int))

    return _Drawn(palette, (size_m, course_m), loop)


def _shade(colour: np.ndarray, factor: float) -> np.ndarray:
    return np.clip(factor * colour + 0.04 * (factor > 1), 0, 1)


_TONES = 5
_THREADS = 180  # after which they repeat


def _threads(rng: np.random.Generator) -> Callable[[np.ndarray, float], np.ndarray]:
    """(length, distance of threads) -> the tone of the thread there."""
    tone = np.clip(np.round(_TONES / 2 + rng.normal(size=_THREADS)), 0, _TONES - 1).astype(int)
    return lambda length, step_m: tone[np.floor(length / step_m).astype(int) % _THREADS]


def _plain(colours: np.ndarray, size_m: float, rng: np.random.Generator) -> _Drawn:
    return _Drawn(colours[:1], (0.01, 0.01), lambda x, y: _flat(np.array([[0]]), x, y))


_LINE_M = 0.0014
_KINDS: dict[str, Callable[[np.ndarray, float, np.random.Generator], _Drawn]] = {
    "plain": _plain,
    "stripes": _stripes,
    "pinstripe": _pinstripe,
    "breton": _breton,
    "gingham": _gingham,
    "tartan": _tartan,
    "dots": _dots,
    "flowers": _flowers,
    "herringbone": _herringbone,
    "houndstooth": _houndstooth,
    "twill": _twill,
    "slub": _slub,
    "knit": _knit,
}
