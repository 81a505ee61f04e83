"""Variables of MATLAB v5 files: numbers, text, structs and cells, read strictly.

SciPy's reader follows what a damaged file says into memory that is not its own. This one knows only
what CLOTH3D's files hold, checks every size against what is left of the element it is in, and gives
the values as `scipy.io.loadmat(squeeze_me=True)` does, with structs as dicts and cells as lists.
The format is described in "MAT-File Format", MathWorks.
"""

import math
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from drapeline.errors import InputError, refuse_damage

_HEADER = 128
_ANY_SIZE, _MOST_PACKED = 64 << 20, 64  # of what compressed elements unpack to
_DEEPEST, _LONGEST_SHAPE = 12, 32  # nested structs; bytes of a shape
_PAIRS = {order: struct.Struct(f"{order}II") for order in "<>"}
# Types of data elements.
_NUMBERS = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
}
_TEXT = {2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_INT8, _INT32, _UINT32, _MATRIX, _COMPRESSED = 1, 5, 6, 14, 15
# Classes of arrays.
_CELL, _STRUCT, _CHAR = 1, 2, 4
_NUMERIC = range(6, 16)
_COMPLEX = 0x800


class _Reader:
    """Takes elements off a stretch of a file's bytes, one after the other."""

    def __init__(self, data: bytes, order: str, place: int, end: int) -> None:
        self.data, self.order, self.place, self.end = data, order, place, end
        self._pair = _PAIRS[order]

    def element(self, *, padded: bool = True) -> tuple[int, int, int]:
        """Type of the next element, and where its data start and end.

        Within arrays elements start at multiples of eight bytes.
        """
        start = self.place + 8
        if start > self.end:
            raise ValueError("an element is cut off")
        kind, size = self._pair.unpack_from(self.data, self.place)
        if kind >> 16:  # size and type in one number, the data in the other half of the tag
            kind, size, start = kind & 0xFFFF, kind >> 16, start - 4
            if size > 4:
                raise ValueError(f"a small element of {size} bytes")
            self.place += 8
        else:
            self.place = start + size + (-size % 8 if padded else 0)
        if start + size > self.end:
            raise ValueError(f"an element of {size} bytes, {self.end - start} are left")
        return kind, start, start + size

    def integers(self, kind: int) -> tuple[int, ...]:
        """Those of the next element, which is of this type."""
        found, start, end = self.element()
        if found != kind or (end - start) % 4 or end - start > _LONGEST_SHAPE:
            raise ValueError(f"an element of type {found}, expected {kind}")
        form = f"{self.order}{(end - start) // 4}{'I' if kind == _UINT32 else 'i'}"
        return struct.unpack_from(form, self.data, start)

    def text(self) -> bytes:
        """The next element, which is a name."""
        kind, start, end = self.element()
        if kind != _INT8:
            raise ValueError(f"a name of type {kind}")
        return self.data[start:end]


def read_matlab(path: str | Path) -> dict[str, Any]:
    """Variables of a file by name.

    Numbers are arrays without their axes of length one, or plain numbers; text is `str`.

    Raises:
        InputError: the file is missing, damaged, of another version, or holds objects, functions,
            sparse or complex arrays.
    """
    with refuse_damage(path, "a MATLAB v5 file"):
        data = Path(path).read_bytes()
        order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
        if order is None or struct.unpack(f"{order}H", data[124:126])[0] != 0x0100:
            raise ValueError("it has no header of version 5")
        return _variables(path, data, order)


def _variables(path: str | Path, data: bytes, order: str) -> dict[str, Any]:
    reader, found = _Reader(data, order, _HEADER, len(data)), {}
    allowed = _ANY_SIZE + _MOST_PACKED * len(data)
    while reader.place < len(data):
        kind, start, end = reader.element(padded=False)
        inside = reader
        if kind == _COMPRESSED:
            unpacker = zlib.decompressobj()
            inner = unpacker.decompress(data[start:end], max(allowed, 1))
            if unpacker.unconsumed_tail or not unpacker.eof:
                raise InputError(f"{path}: a packed element is cut off or too large for its file")
            allowed -= len(inner)
            inside = _Reader(inner, order, 0, len(inner))
            kind, start, end = inside.element(padded=False)
        if kind != _MATRIX:
            raise ValueError(f"an element of type {kind}, expected an array")
        name, value = _array(_Reader(inside.data, order, start, end), 0)
        found[name] = value
    return found


def _array(reader: _Reader, depth: int) -> tuple[str, Any]:
    """Name and value of the array whose element a reader stands in."""
    if depth > _DEEPEST:
        raise ValueError("structs in structs without end")
    flags, shape = reader.integers(_UINT32), reader.integers(_INT32)
    if len(flags) != 2 or len(shape) < 2 or min(shape) < 0:
        raise ValueError(f"flags {flags} and shape {shape}")
    name = reader.text().rstrip(b"\0").decode("latin-1")
    kind = flags[0] & 0xFF
    if flags[0] & _COMPLEX:
        raise ValueError("complex numbers")
    if kind in _NUMERIC:
        return name, _squeezed(_numbers(reader, shape))
    if kind == _CHAR:
        return name, _text(reader, shape)
    if kind == _CELL:
        return name, _cells(reader, shape, depth)
    if kind == _STRUCT:
        return name, _fields(reader, shape, depth)
    raise ValueError(f"an array of class {kind}, expected numbers, text, structs or cells")


def _numbers(reader: _Reader, shape: tuple[int, ...]) -> np.ndarray:
    kind, start, end = reader.element()
    if kind not in _NUMBERS:
        raise ValueError(f"numbers of type {kind}")
    dtype = np.dtype(reader.order + _NUMBERS[kind])
    count = math.prod(shape)
    if count * dtype.itemsize != end - start:
        raise ValueError(f"{end - start} bytes in an array of shape {shape}")
    flat = np.frombuffer(reader.data, dtype, count, start) if count else np.zeros(0, dtype)
    return flat.copy().reshape(shape, order="F")


def _squeezed(array: np.ndarray) -> Any:
    if not array.size:
        return np.zeros(0, array.dtype)
    array = np.squeeze(array)
    return array if array.shape else array.item()


def _text(reader: _Reader, shape: tuple[int, ...]) -> str:
    """One row; more rows are no text that these files have."""
    kind, start, end = reader.element()
    if kind not in _TEXT:
        raise ValueError(f"text of type {kind}")
    code = _TEXT[kind]
    ending = ("-le" if reader.order == "<" else "-be") if code in ("utf-16", "utf-32") else ""
    text = reader.data[start:end].decode(code + ending)
    if len(text) != math.prod(shape) or (text and shape[0] != 1):
        raise ValueError(f"{len(text)} characters in an array of shape {shape}")
    return text.rstrip("\0")


def _cells(reader: _Reader, shape: tuple[int, ...], depth: int) -> Any:
    """A list, or what is in the only cell."""
    count = math.prod(shape)
    if count > reader.end - reader.place:
        raise ValueError(f"a cell array of shape {shape}")
    cells = [_inner(reader, depth) for _ in range(count)]
    return cells[0] if count == 1 else cells


def _fields(reader: _Reader, shape: tuple[int, ...], depth: int) -> dict[str, Any]:
    (length,) = reader.integers(_INT32)
    names = reader.text()
    if not 0 < length <= 64 or len(names) % length or math.prod(shape) != 1:
        raise ValueError(f"a struct array of shape {shape} with names of {length} letters")
    fields = [names[k : k + length] for k in range(0, len(names), length)]
    return {field.partition(b"\0")[0].decode("latin-1"): _inner(reader, depth) for field in fields}


def _inner(reader: _Reader, depth: int) -> Any:
    kind, start, end = reader.element()
    if kind != _MATRIX:
        raise ValueError(f"an element of type {kind}, expected an array")
    if start == end:
        return np.zeros(0)
    return _array(_Reader(reader.data, reader.order, start, end), depth + 1)[1]
