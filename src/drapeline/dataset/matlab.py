"""Variables of MATLAB v5 files: numbers, text, structs and cells, read strictly.

SciPy's reader follows what a damaged file says into memory that is not its own. This one knows only
what CLOTH3D's files hold, checks every size against what is left of the element it is in, and gives
the values as `scipy.io.loadmat(squeeze_me=True)` does, with structs as dicts and cells as lists.
The format is described in "MAT-File Format", MathWorks.
"""

import io
import math
import os
import struct
import zlib
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from drapeline.errors import DamagedFile, refuse_damage

_HEADER = 128
_ANY_SIZE, _MOST_PACKED = 64 << 20, 64  # of what compressed elements unpack to
_DEEPEST, _LONGEST_SHAPE = 12, 32  # nested structs; bytes of a shape
_LONGEST_HEAD = 256  # bytes of an array's flags, shape and name
_FIRST_READ = 1 << 14  # bytes; enough for all of a sample but its poses
_PAIRS = {order: struct.Struct(f"{order}II") for order in "<>"}
_HEADS = {order: struct.Struct(f"{order}6I") for order in "<>"}
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


def read_matlab(
    path: str | Path, names: Collection[str] | None = None, outlines: Collection[str] = ()
) -> dict[str, Any]:
    """Variables of a file by name.

    Numbers are arrays without their axes of length one, or plain numbers; text is `str`.

    Args:
        names: of the variables to read, all if None. Of others only sizes and names are looked at,
            and as little of the file is read as that takes.
        outlines: structs, among those names, of which only the names of their fields are read:
            their values are None.

    Raises:
        InputError: the file is missing, damaged, of another version, or holds objects, functions,
            sparse or complex arrays.
    """
    with refuse_damage(path, "a MATLAB v5 file"), open(path, "rb", buffering=0) as stream:
        data = stream.read(-1 if names is None else _FIRST_READ)
        order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
        if order is None or struct.unpack(f"{order}H", data[124:126])[0] != 0x0100:
            raise ValueError("it has no header of version 5")
        reader = _FileReader(stream, data, order)
        return _variables(path, reader, names, outlines)


class _FileReader(_Reader):
    """Takes variables off a file of which only the beginning is in memory."""

    def __init__(self, stream: io.FileIO, data: bytes, order: str) -> None:
        size = max(os.fstat(stream.fileno()).st_size, len(data))
        super().__init__(data, order, _HEADER, size)
        self._stream = stream

    def reach(self, end: int) -> None:
        """Have the bytes up to `end` in memory, as far as the file goes."""
        if len(self.data) < min(end, self.end):
            self.data += self._stream.read()
            self.end = len(self.data)


def _variables(
    path: str | Path, reader: _FileReader, names: Collection[str] | None, outlines: Collection[str]
) -> dict[str, Any]:
    found: dict[str, Any] = {}
    allowed = _ANY_SIZE + _MOST_PACKED * reader.end
    while reader.place < reader.end:
        reader.reach(reader.place + 8 + _LONGEST_HEAD)
        kind, start, end = reader.element(padded=False)
        data = reader.data
        if kind == _COMPRESSED:
            reader.reach(end)
            unpacker = zlib.decompressobj()
            data = unpacker.decompress(reader.data[start:end], max(allowed, 1))
            if unpacker.unconsumed_tail or not unpacker.eof:
                raise DamagedFile(path, "a packed element is cut off or too large for its file")
            allowed -= len(data)
            kind, start, end = _Reader(data, reader.order, 0, len(data)).element(padded=False)
        if kind != _MATRIX:
            raise ValueError(f"an element of type {kind}, expected an array")
        if names is not None and _name(data, reader.order, start, end) not in names:
            continue
        if data is reader.data:
            reader.reach(end)
            data = reader.data
        array = _Reader(data, reader.order, start, end)
        name, value = _array(array, 0, outlines)
        found[name] = value
    return found


def _name(data: bytes, order: str, start: int, end: int) -> str:
    """Of the array whose element is there; its flags and shape are passed over in one step."""
    head = _HEADS[order].unpack_from(data, start)
    if (head[0], head[1], head[4]) != (_UINT32, 8, _INT32):
        raise ValueError(f"flags and shape of types {head[0]} and {head[4]}")
    place = start + 24 + head[5] + -head[5] % 8
    text = _Reader(data, order, place, min(end, start + _LONGEST_HEAD)).text()
    return text.rstrip(b"\0").decode("latin-1")


def _array(reader: _Reader, depth: int, outlines: Collection[str] = ()) -> tuple[str, Any]:
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
        fields = _fields(reader, shape)
        if name in outlines:
            return name, dict.fromkeys(fields)
        return name, {field: _inner(reader, depth) for field in fields}
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


def _fields(reader: _Reader, shape: tuple[int, ...]) -> list[str]:
    (length,) = reader.integers(_INT32)
    names = reader.text()
    if not 0 < length <= 64 or len(names) % length or math.prod(shape) != 1:
        raise ValueError(f"a struct array of shape {shape} with names of {length} letters")
    fields = [names[k : k + length] for k in range(0, len(names), length)]
    return [field.partition(b"\0")[0].decode("latin-1") for field in fields]


def _inner(reader: _Reader, depth: int) -> Any:
    kind, start, end = reader.element()
    if kind != _MATRIX:
        raise ValueError(f"an element of type {kind}, expected an array")
    if start == end:
        return np.zeros(0)
    return _array(_Reader(reader.data, reader.order, start, end), depth + 1)[1]
