"""Headers of `.npy` arrays read strictly: what an array will be is known before memory is taken."""

import io
import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

_MAGIC = b"\x93NUMPY"
_LONGEST_HEADER = 4096
# As NumPy writes it, and Python 2 did ("3L"); any order of the keys.
_ENTRY = re.compile(
    r"\s*'(?:(descr)'\s*:\s*'([<>|=]?[a-zA-Z]\d*)'|(fortran_order)'\s*:\s*(True|False)"
    r"|(shape)'\s*:\s*\(((?:\s*\d{1,18}L?\s*,)*\s*(?:\d{1,18}L?)?)\s*\))\s*,?"
)
# Kinds of numbers by the word that a table of arrays declares them with.
KINDS = {"float": "f", "int": "iu", "number": "fiu", "bool": "b", "str": "U", "any": "fiubU"}
# No length, angle or weight of any file is larger; squares of what is overflow single precision.
LARGEST = 1e18
_MOST_DIMENSIONS = 8


class HeaderError(ValueError):
    """An array is none that this reads; the message says why."""


@dataclass(frozen=True)
class Header:
    """Description of an array in its `.npy` file."""

    dtype: np.dtype  # of numbers, truth values or text
    shape: tuple[int, ...]
    fortran: bool  # whether the first axis varies fastest
    size: int  # bytes of the header

    @property
    def nbytes(self) -> int:
        """Bytes of the array."""
        return math.prod(self.shape) * self.dtype.itemsize


def read_header(stream: io.BufferedIOBase) -> Header:
    """Read the header at the start of a stream.

    Raises:
        HeaderError: it is none, or of an array of Python objects, fields, dates or raw bytes.
    """
    start = stream.read(10)
    if len(start) < 10 or start[:6] != _MAGIC or start[6] not in (1, 2, 3):
        raise HeaderError("does not start like an .npy array")
    if start[6] > 1:  # two more bytes of length
        start += stream.read(2)
    length = int.from_bytes(start[8:], "little")
    text = stream.read(length) if length <= _LONGEST_HEADER else b""
    if not text or len(text) < length:
        raise HeaderError("has a header that is cut off or too long")
    dtype, fortran, shape = _parse(text.decode("latin-1").strip())
    return Header(dtype, shape, fortran, len(start) + length)


def _parse(text: str) -> tuple[np.dtype, bool, tuple[int, ...]]:
    if not text.startswith("{") or not text.endswith("}"):
        raise HeaderError("has an unreadable header")
    place, found = 1, {}
    while match := _ENTRY.match(text, place):
        name, value = (part for part in match.groups() if part is not None)
        found[name], place = value, match.end()
    if text[place:].strip() != "}" or len(found) != 3:
        kind = "is an array of fields, expected plain numbers" if "[(" in text else None
        raise HeaderError(kind or "has an unreadable header")
    dtype = plain_dtype(found["descr"])
    shape = tuple(
        int(part.strip().rstrip("L")) for part in found["shape"].split(",") if part.strip()
    )
    if len(shape) > _MOST_DIMENSIONS:
        raise HeaderError(f"has {len(shape)} dimensions, expected at most {_MOST_DIMENSIONS}")
    return dtype, found["fortran_order"] == "True", shape


def plain_dtype(name: str) -> np.dtype:
    """A type of numbers, truth values or text by its code, such as "<f4".

    Raises:
        HeaderError: it is any other type.
    """
    if name.lstrip("<>|=")[:1] == "O":
        raise HeaderError("holds Python objects (pickles), which are never opened")
    try:
        dtype = np.dtype(name)
    except (TypeError, ValueError):
        raise HeaderError(f"is of the unknown type '{name}'") from None
    # Long double differs from processor to processor.
    if dtype.kind not in KINDS["any"] or (dtype.kind == "f" and dtype.itemsize > 8):
        raise HeaderError(f"is of the type '{name}', expected numbers or text")
    return dtype


def read_array(stream: io.BufferedIOBase, header: Header) -> np.ndarray:
    """The array after its header.

    Raises:
        HeaderError: the stream ends before the array does.
    """
    flat = np.zeros(math.prod(header.shape), header.dtype)
    view = flat.view(np.uint8).data if flat.nbytes else memoryview(b"")
    place = 0
    while place < flat.nbytes:
        read = stream.readinto(view[place : place + (1 << 20)])
        if not read:
            raise HeaderError(f"ends after {place} of {flat.nbytes} bytes")
        place += read
    if header.fortran:
        return flat.reshape(header.shape[::-1]).T
    return flat.reshape(header.shape)


_KIND = re.compile(r"(\w+?)(\|nan)?(?:<(\w+))?")


def _parts(kind: str) -> tuple[str, str | None, str | None]:
    """Word, "|nan" and limit of a declaration such as "int<f" or "float|nan"."""
    match = _KIND.fullmatch(kind)
    if match is None:
        raise ValueError(f"'{kind}' declares no array")
    return match[1], match[2], match[3]


_WORDS = {"int": "whole numbers", "bool": "truth values", "str": "text", "any": "values"}


class Declared:
    """Arrays as a table declares them; names of axes stand for the same size in all of them.

    A declaration is a kind of `KINDS` and the sizes of the axes, such as "float n 72": a number, a
    name, `*` for any size, or `...` for any further axes. Floats are finite and at most `LARGEST`
    in size; "float|nan n 72" may hold any, NaN and infinity too. "int<n f 3" holds indices from 0
    to below n.

    Attributes:
        sizes: axis -> its size, where known.
    """

    def __init__(self, sizes: Mapping[str, int]) -> None:
        self.sizes = dict(sizes)

    def check_header(self, form: str, header: Header) -> None:
        """Compare a header with a declaration.

        Raises:
            HeaderError: says what was found and expected.
        """
        kind, *axes = form.split()
        word = _parts(kind)[0]
        # NumPy makes empty lists float64, whatever they would hold.
        right_kind = header.dtype.kind in KINDS[word] or 0 in header.shape
        if not right_kind or not self._fit(header.shape, axes):
            sizes = [str(self.sizes.get(axis, axis)) for axis in axes]
            shown = f"({', '.join(sizes)}{',' * (len(sizes) == 1)})"
            raise HeaderError(
                f"has shape {header.shape} and type {header.dtype}, expected {shown}"
                f" {_WORDS.get(word, 'numbers')}"
            )

    def _fit(self, shape: tuple[int, ...], axes: list[str]) -> bool:
        if axes and axes[-1] == "...":
            axes, shape = axes[:-1], shape[: len(axes) - 1]
        if len(axes) != len(shape):
            return False
        for axis, size in zip(axes, shape, strict=True):
            wanted = size if axis == "*" else int(axis) if axis.isdigit() else None
            if wanted is None:
                wanted = self.sizes.setdefault(axis, size)
            if wanted != size:
                return False
        return True

    def check_values(self, form: str, array: np.ndarray) -> None:
        """Refuse values that are no numbers, truth values, characters or indices.

        Call it once the headers of all arrays are checked, which tells the size of each axis.

        Raises:
            HeaderError: says which.
        """
        _, may_be_nan, limit = _parts(form.split()[0])
        if not array.size:
            return
        if array.dtype.kind == "b" and array.view(np.uint8).max() > 1:
            raise HeaderError("holds a truth value that is neither 0 nor 1")
        if array.dtype.kind == "U":
            _check_text(array)
        # The least and the largest are NaN if any value is, and need no memory.
        ends = [] if may_be_nan or array.dtype.kind != "f" else [array.min(), array.max()]
        if not np.isfinite(ends).all():
            raise HeaderError("holds NaN or infinity, expected finite numbers")
        largest = max(map(abs, ends), default=0.0)
        if largest > LARGEST:
            raise HeaderError(f"holds {largest:.3g}, expected numbers up to {LARGEST:g}")
        if limit is not None:
            most = int(limit) if limit.isdigit() else self.sizes[limit]
            least, last = int(array.min()), int(array.max())
            if least < 0 or last >= most:
                wrong = least if least < 0 else last
                raise HeaderError(f"names number {wrong}, expected 0 to {most - 1}")


def check_arrays(arrays: Mapping[str, np.ndarray], table: Mapping[str, str], **sizes: int) -> None:
    """Compare arrays that are in memory, as those of a checkpoint, with a table of declarations.

    Args:
        table: name -> its declaration, see `Declared`.
        sizes: of axes that are known.

    Raises:
        HeaderError: an array is missing, unknown, or not as declared.
    """
    if arrays.keys() != table.keys():
        odd = sorted(arrays.keys() ^ table.keys())[0]
        raise HeaderError(f"'{odd}' is {'unknown' if odd in arrays else 'missing'}")
    declared = Declared(sizes)
    for key, array in arrays.items():
        with _naming(key):
            header = Header(array.dtype, array.shape, fortran=False, size=0)
            declared.check_header(table[key], header)
    for key, array in arrays.items():
        with _naming(key):
            declared.check_values(table[key], array)


@contextmanager
def _naming(key: str) -> Iterator[None]:
    try:
        yield
    except HeaderError as error:
        raise HeaderError(f"'{key}' {error}") from error


def _check_text(array: np.ndarray) -> None:
    if not array.dtype.itemsize:
        return
    code = np.dtype(np.uint32).newbyteorder(array.dtype.byteorder)
    codes = np.ascontiguousarray(array).reshape(-1).view(code)
    if codes.max() > 0x10FFFF or ((codes >= 0xD800) & (codes < 0xE000)).any():
        raise HeaderError("holds text with an impossible character")
