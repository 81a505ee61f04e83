"""Reading and writing files: written under a temporary name first, so never left half-written."""

import errno
import json
import os
import shutil
import tempfile
import zipfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from drapeline.errors import InputError

# Failures of the disk rather than of the program.
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
def _report_disk_errors(path: Path) -> Iterator[None]:
    """Turn a full disk or an unwritable folder at `path` into an InputError."""
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
    """Yield a temporary path that replaces `path` if the block ends without an error.

    Raises:
        InputError: the folder is not writable or the disk is full.
    """
    path = Path(path)
    with _report_disk_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        # The suffix is kept because writers such as Blender's and Pillow's choose a format by it.
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
    """Yield a temporary folder that replaces `path` if the block ends without an error.

    Raises:
        InputError: the folder is not writable or the disk is full.
    """
    path = Path(path)
    with _report_disk_errors(path):
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
    """Hard-link a finished file, or copy it if the file system does not support links.

    Linking is safe because all our files are replaced as a whole and never changed in place.
    """
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def open_array(path: str | Path) -> np.ndarray:
    """Memory-map an `.npy` array for reading.

    Raises:
        InputError: the file is missing or does not hold an array.
    """
    try:
        return np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path}: not readable as an array ({error})") from error


def create_array(path: str | Path, dtype: type, shape: tuple[int, ...]) -> np.memmap:
    """Create an `.npy` array to be filled piece by piece; it may be larger than memory."""
    return np.lib.format.open_memmap(path, mode="w+", dtype=dtype, shape=shape)


def save_npz(path: str | Path, **arrays: Any) -> None:
    """Write arrays, strings and numbers to a compressed `.npz`, without pickling anything."""
    for name, value in arrays.items():
        if np.asarray(value).dtype == object:
            raise TypeError(f"{path}: '{name}' is an object array, which would have to be pickled")
    with atomic_file(path) as scratch, open(scratch, "wb") as stream:
        np.savez_compressed(stream, **arrays)


def load_npz(
    path: str | Path, *required: str, optional: Collection[str] = (), only: bool = False
) -> dict[str, np.ndarray]:
    """Read an `.npz` without executing anything in it.

    Args:
        required: keys that the file must have.
        optional: keys that are read where the file has them, even with `only`.
        only: read these keys alone, whatever others hold.

    Raises:
        InputError: the file is missing, unreadable, lacks a required key, or what is read contains
            pickles.
    """
    path = Path(path)
    wanted = {*required, *optional}
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected an .npz with {', '.join(required)}")
    try:
        with np.load(path, allow_pickle=False) as archive:
            names = archive.files
            arrays = {name: archive[name] for name in names if name in wanted or not only}
    except (ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: not a readable .npz of plain arrays ({error})") from error
    missing = [name for name in required if name not in arrays]
    if missing:
        raise InputError(f"{path}: lacks {', '.join(missing)}; it holds {', '.join(sorted(names))}")
    return arrays


def write_json(path: str | Path, value: Any) -> None:
    """Write JSON at full precision; NaN is refused because JSON cannot express it."""
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
