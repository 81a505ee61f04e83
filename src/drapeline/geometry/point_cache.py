"""Vertex animations on disk, written and read frame by frame.

Four layouts share one writer and one reader; the suffix of the file says which it is:

========  ============================================  =======================
suffix    header                                        body, frame after frame
========  ============================================  =======================
`.pc2`    32 bytes, little endian                       float32, little endian
`.pc16`   the same 32 bytes (CLOTH3D)                   float16, little endian
`.mdd`    frame and vertex count, one time per frame    float32, big endian
`.f32`    none: the vertex count comes from the OBJ     float32, little endian
========  ============================================  =======================

The 32 bytes are `POINTCACHE2` and a zero byte, int32 version 1, int32 vertices, float32 first
frame 0, float32 frames per sample 1, int32 frames.
"""

import os
import struct
from collections.abc import Iterable, Iterator, Sized
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from typing import BinaryIO
from weakref import WeakSet

import numpy as np

from drapeline.errors import DamagedFile, InputError, refuse_damage
from drapeline.frames import FPS
from drapeline.storage import atomic_file

_PC_HEADER = struct.Struct("<12siiffi")
_PC_MAGIC = b"POINTCACHE2\0"
_MDD_HEADER = struct.Struct(">ii")
_DTYPES = {".pc2": "<f4", ".pc16": "<f2", ".mdd": ">f4", ".f32": "<f4"}
_HALF_FIELDS = np.int32(~0x70001FFF)  # the sign bit, and the shifted exponent and mantissa
SUFFIXES = tuple(_DTYPES)


class PointCacheWriter:
    """Appends frames to an open cache; see `point_cache_writer`.

    Attributes:
        frame_count: frames appended so far.
    """

    def __init__(self, stream: BinaryIO, path: Path, vertex_count: int) -> None:
        self.frame_count = 0
        self._stream, self._path, self._vertex_count = stream, path, vertex_count
        self._dtype = _dtype_of(path)

    def append(self, frames: np.ndarray) -> None:
        """Add one frame (V, 3) or several (N, V, 3), in metres."""
        frames = np.asarray(frames)
        if frames.ndim not in (2, 3) or frames.shape[-2:] != (self._vertex_count, 3):
            raise ValueError(
                f"{self._path}: frames have shape {frames.shape},"
                f" expected (N, {self._vertex_count}, 3)"
            )
        self._stream.write(np.ascontiguousarray(frames, dtype=self._dtype).data)
        self.frame_count += 1 if frames.ndim == 2 else len(frames)


@contextmanager
def point_cache_writer(
    path: str | Path, vertex_count: int, *, frame_count: int | None = None
) -> Iterator[PointCacheWriter]:
    """Yield a writer; the cache appears under its name if the block ends without an error.

    Memory does not grow with the number of frames: the header's frame count is filled in last.

    Args:
        path: ends in one of `SUFFIXES`, which chooses the layout.
        frame_count: frames that will be written. Only `.mdd` needs it, since its table of times
            stands before the frames; where given, any other number of frames is an error.
    """
    path = Path(path)
    _dtype_of(path)
    if path.suffix == ".mdd" and frame_count is None:
        raise ValueError(f"{path}: an .mdd file needs its frame count before the first frame")
    with atomic_file(path) as scratch, open(scratch, "wb") as stream:
        stream.write(_header(path.suffix, vertex_count, frame_count or 0))
        writer = PointCacheWriter(stream, path, vertex_count)
        yield writer
        if frame_count not in (None, writer.frame_count):
            raise ValueError(f"{path}: {writer.frame_count} frames written, not {frame_count}")
        stream.seek(0)
        stream.write(_header(path.suffix, vertex_count, writer.frame_count))


def _header(suffix: str, vertices: int, frames: int) -> bytes:
    if suffix == ".f32":
        return b""
    if suffix == ".mdd":
        times = np.arange(frames) / FPS
        return _MDD_HEADER.pack(frames, vertices) + times.astype(">f4").tobytes()
    return _PC_HEADER.pack(_PC_MAGIC, 1, vertices, 0.0, 1.0, frames)


def write_point_cache(path: str | Path, frames: np.ndarray | Iterable[np.ndarray]) -> int:
    """Write an array (N, V, 3), or any iterable of frames (V, 3), and return the frame count.

    An `.mdd` needs an array (or a list), since its header counts the frames.
    """
    known = len(frames) if isinstance(frames, Sized) else None
    stream = iter(frames)
    try:
        first = np.asarray(next(stream))
    except StopIteration:
        raise ValueError(f"{path}: no frames to write") from None
    with point_cache_writer(path, len(first), frame_count=known) as writer:
        writer.append(first)
        for frame in stream:
            writer.append(frame)
    return writer.frame_count


_KEPT_OPEN: WeakSet[FileIO] = WeakSet()
_MOST_OPEN = 400  # systems give a process as few as 1,024 handles


class PointCache:
    """Frames of one cache file, read on demand by position (no seeking, no whole-file reads).

    The first few hundred of a process keep their files open, the others open them to read.
    One object may be shared by threads and by forked processes, and can be pickled.
    """

    def __init__(self, path: str | Path, vertex_count: int | None = None) -> None:
        """Open a cache and check that its size is what it should be.

        Args:
            path: ends in one of `SUFFIXES`.
            vertex_count: vertices that the mesh has; checked against the header. An `.f32`
                has no header, so there it is required.

        Raises:
            InputError: missing, truncated, not of this layout, or of another vertex count.
        """
        self.path = Path(path)
        self._dtype = _dtype_of(self.path)
        self._stream: FileIO | None = self._open()
        handle = self._stream.fileno()
        size = os.fstat(handle).st_size
        self.vertex_count, self.frame_count, self._start = self._layout(handle, size, vertex_count)
        self._frame_bytes = self.vertex_count * 3 * self._dtype.itemsize
        expected = self._start + self.frame_count * self._frame_bytes
        if size != expected:
            raise DamagedFile(
                self.path,
                f"{size} bytes, expected {expected} for {self.frame_count} frames of"
                f" {self.vertex_count} vertices",
            )
        if vertex_count not in (None, self.vertex_count):
            raise InputError(
                f"{self.path}: {self.vertex_count} vertices per frame, expected {vertex_count}"
                " as in the mesh beside it"
            )
        if len(_KEPT_OPEN) < _MOST_OPEN:
            _KEPT_OPEN.add(self._stream)
        else:
            self._stream.close()
            self._stream = None

    def _open(self) -> FileIO:
        with refuse_damage(self.path, "a point cache"):
            return FileIO(self.path)

    def _layout(self, handle: int, size: int, vertex_count: int | None) -> tuple[int, int, int]:
        """Vertices, frames and the byte at which the first frame starts."""
        if self.path.suffix == ".f32":
            if not vertex_count:
                raise ValueError("an .f32 file has no header: give the vertex count")
            return vertex_count, size // (12 * vertex_count), 0
        header = _MDD_HEADER if self.path.suffix == ".mdd" else _PC_HEADER
        if size < header.size:
            raise DamagedFile(
                self.path, f"{size} bytes, expected at least {header.size} for the header"
            )
        fields = header.unpack(os.pread(handle, header.size, 0))
        if self.path.suffix == ".mdd":
            frames, vertices = fields
            start = header.size + 4 * frames
        else:
            magic, version, vertices, _, _, frames = fields
            start = header.size
            if magic != _PC_MAGIC or version != 1:
                raise DamagedFile(
                    self.path,
                    f"starts with {magic!r} version {version}, expected {_PC_MAGIC!r} version 1",
                )
        if vertices <= 0 or frames < 0:
            raise DamagedFile(
                self.path,
                f"header names {vertices} vertices and {frames} frames, expected positive counts",
            )
        return vertices, frames, start

    def __len__(self) -> int:
        return self.frame_count

    def __reduce__(self) -> tuple:
        return PointCache, (self.path, self.vertex_count)

    def frames(self, start: int = 0, stop: int | None = None) -> np.ndarray:
        """Frames [start, stop) as (stop - start, V, 3) float32, in metres.

        Raises:
            IndexError: the range is not within the file.
        """
        stop = self.frame_count if stop is None else stop
        if not 0 <= start <= stop <= self.frame_count:
            raise IndexError(
                f"{self.path}: frames [{start}, {stop}) asked for, expected within"
                f" [0, {self.frame_count})"
            )
        data = self._read(start, stop)
        shape = (stop - start, self.vertex_count, 3)
        if self._dtype == np.float16:
            return half_to_single(np.frombuffer(data, dtype="<u2")).reshape(shape)
        return np.frombuffer(data, dtype=self._dtype).reshape(shape).astype(np.float32, copy=False)

    def _read(self, start: int, stop: int) -> bytearray:
        """The bytes of frames [start, stop); one read may return less than asked for."""
        buffer = bytearray((stop - start) * self._frame_bytes)
        view, done = memoryview(buffer), 0
        offset = self._start + start * self._frame_bytes
        stream = self._stream or self._open()
        try:
            while done < len(buffer):
                got = os.preadv(stream.fileno(), [view[done:]], offset + done)
                if got == 0:
                    raise DamagedFile(self.path, f"ends at byte {offset + done}, while being read")
                done += got
        finally:
            if stream is not self._stream:
                stream.close()
        return buffer

    def close(self) -> None:
        """Let go of the file; it is also let go of when nothing refers to the object."""
        if self._stream is not None:
            _KEPT_OPEN.discard(self._stream)
            self._stream.close()

    def __enter__(self) -> "PointCache":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def half_to_single(bits: np.ndarray) -> np.ndarray:
    """Float16 values, given as uint16 bit patterns (n,), as float32; exact.

    Three times faster than numpy's own conversion, which goes value by value: sign and mantissa
    are shifted into place, and one multiplication by a power of two corrects the exponent's bias.
    """
    wide = bits.view(np.int16).astype(np.int32)  # sign-extended
    wide <<= 13
    wide &= _HALF_FIELDS
    single = wide.view(np.float32)
    single *= np.float32(2.0**112)
    # Infinities and NaNs come out as 65,536 and more, which no finite half-precision number is.
    if single.size and max(single.max(), -single.min()) >= 65536:
        return bits.view(np.float16).astype(np.float32)
    return single


def _dtype_of(path: Path) -> np.dtype:
    if path.suffix not in _DTYPES:
        raise InputError(f"{path}: suffix '{path.suffix}', expected one of {', '.join(SUFFIXES)}")
    return np.dtype(_DTYPES[path.suffix])
