"""Files that are whole or absent: everything is written beside its target and then renamed."""

import errno
import json
import os
import shutil
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from drapeline.errors import InputError

# What the disk, not the program, does wrong.
_DISK_ERRORS = {
    errno.EACCES,
    errno.EDQUOT,
    errno.EEXIST,
    errno.EFBIG,
    errno.EIO,
    errno.ENOSPC,
    errno.ENOTDIR,
    errno.EPERM,
    errno.EROFS,
}


@contextmanager
def _disk_errors_named(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        place = path if error.filename is None else Path(error.filename)
        ours = place.parent == path.parent or place in path.parents
        if error.errno not in _DISK_ERRORS or not ours:
            raise
        raise InputError(
            f"{path}: cannot be written ({os.strerror(error.errno)}),"
            " expected a writable folder with free disk space"
        ) from error


@contextmanager
def atomic_file(path: str | Path) -> Iterator[Path]:
    """Yield a scratch path that replaces `path` when the block ends without an error.

    Raises:
        InputError: the folder is not writable or the disk is full.
    """
    path = Path(path)
    with _disk_errors_named(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        # The suffix stays last: writers such as Blender's and Pillow's choose a format by it.
        handle, name = tempfile.mkstemp(
            dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix
        )
        os.close(handle)
        scratch = Path(name)
        try:
            yield scratch
            scratch.chmod(0o666 & ~_umask())  # mkstemp makes files private
            os.replace(scratch, path)
        finally:
            scratch.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: str | Path) -> Iterator[Path]:
    """Yield a scratch folder that replaces `path` when the block ends without an error.

    Raises:
        InputError: the folder is not writable or the disk is full.
    """
    path = Path(path)
    with _disk_errors_named(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}-"))
        try:
            yield scratch
            scratch.chmod(0o777 & ~_umask())
            if path.exists():
                shutil.rmtree(path)
            os.replace(scratch, path)
        finally:
            shutil.rmtree(scratch, ignore_errors=True)


def _umask() -> int:
    umask = os.umask(0)
    os.umask(umask)
    return umask


def link_or_copy(source: str | Path, target: str | Path) -> None:
    """Give a finished file a second name, or copy it where the disk cannot link.

    Safe for files that are only ever replaced as a whole, as all of ours are.
    """
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def open_array(path: str | Path) -> np.ndarray:
    """An `.npy` array, memory-mapped for reading.

    Raises:
        InputError: it is missing or no array.
    """
    try:
        return np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path}: not readable as an array ({error})") from error


def create_array(path: str | Path, dtype: type, shape: tuple[int, ...]) -> np.memmap:
    """An `.npy` array to fill piece by piece, which may be larger than memory."""
    return np.lib.format.open_memmap(path, mode="w+", dtype=dtype, shape=shape)


def save_npz(path: str | Path, **arrays: Any) -> None:
    """Write arrays (strings and numbers included, nothing pickled) to a compressed `.npz`."""
    for name, value in arrays.items():
        if np.asarray(value).dtype == object:
            raise TypeError(f"{path}: '{name}' is an object array, which only a pickle could hold")
    with atomic_file(path) as scratch, open(scratch, "wb") as stream:
        np.savez_compressed(stream, **arrays)


def load_npz(path: str | Path, *required: str, only: bool = False) -> dict[str, np.ndarray]:
    """Read an `.npz` without executing anything in it.

    Args:
        required: keys that have to be there.
        only: leave the others unread.

    Raises:
        InputError: the file is missing, unreadable, holds pickles or lacks a required key.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected an .npz with {', '.join(required)}")
    try:
        with np.load(path, allow_pickle=False) as archive:
            found = archive.files
            arrays = {name: archive[name] for name in found if name in required or not only}
    except (ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: not a readable .npz of plain arrays ({error})") from error
    missing = [name for name in required if name not in arrays]
    if missing:
        raise InputError(f"{path}: lacks {', '.join(missing)}; it holds {', '.join(sorted(found))}")
    return arrays


def write_json(path: str | Path, value: Any) -> None:
    """Write JSON with full precision; NaN is refused since JSON has none."""
    with atomic_file(path) as scratch:
        scratch.write_text(json.dumps(value, indent=2, allow_nan=False) + "\n")


def read_json(path: str | Path) -> Any:
    """Read JSON.

    Raises:
        InputError: the file is missing or is not JSON.
    """
    path = Path(path)
    try:
        return json.loads(path.read_text())
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file, expected JSON") from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not readable as JSON ({error})") from error
