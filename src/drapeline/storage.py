"""Reading and writing files: written under a temporary name first, so never left half-written."""

import csv
import ctypes
import errno
import fcntl
import io
import json
import math
import os
import re
import shutil
import socket
import tempfile
import time
import zipfile
import zlib
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from fnmatch import fnmatchcase
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, cast, get_args, get_origin, get_type_hints

import numpy as np

from drapeline.errors import DamagedFile, InputError, refuse_damage
from drapeline.npy import Declared, Header, HeaderError, read_array, read_header

Record = TypeVar("Record")
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
def report_disk_errors(path: Path) -> Iterator[None]:
    """Turn a full disk or an unwritable folder at `path` into an InputError.

    Errors that name no file, as of a write that found no room, are taken for errors of `path`.
    """
    try:
        yield
    except OSError as error:
        place = Path(error.filename2 or error.filename or path)  # where to, of two
        within = path.parent in place.parents and _SCRATCH in str(place)
        ours = place.parent == path.parent or place in path.parents or within
        if error.errno not in _DISK_ERRORS or not ours:
            raise
        raise InputError(
            f"{_final_name(path)}: cannot be written ({os.strerror(error.errno)}),"
            " expected a writable folder with free disk space"
        ) from error


@contextmanager
def atomic_file(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path that replaces `path` if the block ends without an error.

    Raises:
        InputError: the folder is not writable or the disk is full.
    """
    path = Path(path)
    with report_disk_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        # The suffix is kept because writers such as Blender's and Pillow's choose a format by it.
        handle, name = tempfile.mkstemp(
            dir=path.parent, prefix=_scratch_prefix(path.stem), suffix=path.suffix
        )
        scratch = Path(name)
        try:
            _claim(handle)
            yield scratch
            scratch.chmod(0o666 & ~_umask())  # mkstemp makes files private
            os.replace(scratch, path)
        finally:
            os.close(handle)
            scratch.unlink(missing_ok=True)


@contextmanager
def copied_file(path: str | Path) -> Iterator[Path]:
    """Yield a path for libraries of C++ to write to, which then is copied by Python to `path`.

    Python says so of a full disk; Alembic's library ends the process, and USD's goes on with what
    it cannot read back.
    """
    with tempfile.TemporaryDirectory() as scratch:
        yield Path(scratch) / Path(path).name
        shutil.copyfile(Path(scratch) / Path(path).name, path)


@contextmanager
def atomic_folder(path: str | Path) -> Iterator[Path]:
    """Yield a temporary folder that replaces `path` if the block ends without an error.

    At `path` there is always a whole folder, the old one or the new one; of several writers the
    last one's stays. Only file systems that cannot exchange two names, such as NFS, have none there
    for a moment; a process killed in it leaves nothing at `path`, and the folder is made anew.

    Raises:
        InputError: the folder is not writable or the disk is full.
    """
    path = Path(path)
    with report_disk_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(dir=path.parent, prefix=_scratch_prefix(path.name)))
        handle = os.open(scratch, os.O_RDONLY)
        try:
            _claim(handle)
            yield scratch
            scratch.chmod(0o777 & ~_umask())
            _replace_folder(scratch, path)
        finally:
            shutil.rmtree(scratch, ignore_errors=True)  # what was at `path`, or what failed
            os.close(handle)


def _replace_folder(scratch: Path, path: Path) -> None:
    """Give a folder the name `path`; what has it so far may get the name `scratch`."""
    while True:
        try:
            os.rename(scratch, path)  # over nothing or an empty folder
            return
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                raise
        if _exchange(scratch, path):
            return
        aside = Path(tempfile.mkdtemp(dir=path.parent, prefix=_scratch_prefix(path.name)))
        try:
            os.rename(path, aside)
        except FileNotFoundError:
            pass  # another writer was here first
        finally:
            shutil.rmtree(aside, ignore_errors=True)


_AT_FDCWD, _RENAME_EXCHANGE = -100, 2


def _exchange(one: Path, other: Path) -> bool:
    """Let two folders swap names at once; False if the system cannot, or one is not there."""
    rename = getattr(ctypes.CDLL(None), "renameat2", None)  # Linux's alone
    if rename is None:
        return False
    names = os.fsencode(one), os.fsencode(other)
    return rename(_AT_FDCWD, names[0], _AT_FDCWD, names[1], _RENAME_EXCHANGE) == 0


# Hidden, so that no listing takes one for a sample. The host and the lock tell whether its writer
# is still at work.
_SCRATCH = ".writing-"
_HOST = socket.gethostname().partition(".")[0]
_FORGOTTEN_S = 24 * 3600


def _scratch_prefix(name: str) -> str:
    return f"{_SCRATCH}{name}@{_HOST}."


def _final_name(path: Path) -> str:
    """A path as it will be, for messages about what is being written within a folder."""
    return re.sub(rf"{re.escape(_SCRATCH)}([^/]+)@[^/@.]*\.[a-z0-9_]{{8}}", r"\1", str(path))


def _claim(handle: int) -> None:
    """Mark an open file or folder as in use; the system takes the mark back when we are killed."""
    with suppress(OSError):  # some file systems have no locks
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


def sweep(root: str | Path) -> list[Path]:
    """Remove what killed processes were writing below a folder, and say what it was.

    What a living process of this machine writes is left alone. Nobody can ask the processes of
    another machine: what those wrote goes once it has not changed for a day.
    """
    removed = []
    for folder, folders, files in os.walk(root):
        scraps = [name for name in (*folders, *files) if name.startswith(_SCRATCH)]
        folders[:] = [name for name in folders if not name.startswith(_SCRATCH)]
        removed += [path for name in scraps if _remove_if_dead(path := Path(folder) / name)]
    return removed


def _remove_if_dead(path: Path) -> bool:
    with suppress(OSError):  # another process may be faster
        if not _in_use(path):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
            return True
    return False


def _in_use(path: Path) -> bool:
    if f"@{_HOST}." in path.name:
        handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return False
        except BlockingIOError:
            return True
        except OSError:
            pass  # a file system without locks
        finally:
            os.close(handle)
    inside = [path, *path.rglob("*")] if path.is_dir() else [path]
    return max(part.lstat().st_mtime for part in inside) > time.time() - _FORGOTTEN_S


def _umask() -> int:
    """Read without a change where the system tells it, as Linux does: other threads make files."""
    with suppress(OSError, ValueError, StopIteration), open("/proc/self/status") as lines:
        return int(next(line for line in lines if line.startswith("Umask:")).split()[1], 8)
    umask = os.umask(0o077)  # for a moment, in which files are private, not open to all
    os.umask(umask)
    return umask


def link_or_copy(source: str | Path, target: str | Path) -> None:
    """Hard-link a finished file, or copy it if the file system does not support links.

    All our files are replaced as a whole and never changed in place. So that nothing else does so
    to both at once, they can only be read from now on.
    """
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)
    else:
        with suppress(OSError):  # another user's
            os.chmod(target, os.stat(target).st_mode & ~0o222)


def copy_file(source: str | Path, target: str | Path) -> None:
    """Copy a file; the system may let both share their blocks until one of them changes.

    Btrfs and XFS do, so that a copy costs neither time nor room.
    """
    try:
        with open(source, "rb") as old, open(target, "wb") as new:
            left = os.fstat(old.fileno()).st_size
            while left:
                left -= os.copy_file_range(old.fileno(), new.fileno(), left) or left
    except (AttributeError, OSError):  # the system or the file system has no such call
        pass
    target = Path(target)
    if not target.exists() or target.stat().st_size != Path(source).stat().st_size:
        shutil.copyfile(source, target)


def copy_folder(source: str | Path, target: str | Path) -> None:
    """Copy a folder with all that is in it but hidden files, such as Snakemake's marks.

    Unlike `shutil.copytree` it ends with the first file that cannot be written.
    """
    Path(target).mkdir(parents=True)
    for entry in sorted(Path(source).iterdir()):
        if entry.name.startswith("."):
            continue
        copy = copy_folder if entry.is_dir() else copy_file
        copy(entry, Path(target) / entry.name)


def output_of(path: str | Path, root: str | Path) -> Path:
    """The output of a rule below `root` that a file is, or is part of, by Snakemake's marks."""
    inside = [folder for folder in Path(path).parents if Path(root) in folder.parents]
    marked = (folder for folder in reversed(inside) if (folder / _MARK).exists())
    return next(marked, Path(path))


_MARK = ".snakemake_timestamp"  # in folders that are outputs


def open_arrays(
    folder: str | Path, table: Mapping[str, str], **sizes: int
) -> dict[str, np.ndarray]:
    """Memory-map the `.npy` files of a folder for reading; values are not looked at.

    Args:
        table: name of the file without its suffix -> kind and axes, see `load_npz`.
        sizes: of axes that are known.

    Raises:
        InputError: a file is missing, is not as declared, or is cut off.
    """
    declared = Declared(sizes)
    return {
        name: _open_array(Path(folder) / f"{name}.npy", form, declared)
        for name, form in table.items()
    }


def _open_array(path: Path, form: str, declared: Declared) -> np.ndarray:
    with refuse_damage(path, "an array"), open(path, "rb") as stream:
        try:
            header = read_header(stream)
            declared.check_header(form, header)
        except HeaderError as error:
            raise DamagedFile(path, str(error)) from error
        size, expected = os.fstat(stream.fileno()).st_size, header.size + header.nbytes
        if size != expected:
            raise DamagedFile(path, f"{size} bytes, expected {expected} as its header says")
        order: Literal["F", "C"] = "F" if header.fortran else "C"
        if not header.nbytes:
            return np.zeros(header.shape, header.dtype, order)
        return np.memmap(path, header.dtype, "r", header.size, header.shape, order)


def create_array(path: str | Path, dtype: type, shape: tuple[int, ...]) -> np.memmap:
    """Create an `.npy` array of zeros to be filled piece by piece; it may be larger than memory.

    Raises:
        OSError: the disk has no room for it. It is reserved here, since a process that writes to a
            mapped page for which there is none is killed without a word.
    """
    header = {
        "descr": np.lib.format.dtype_to_descr(np.dtype(dtype)),
        "fortran_order": False,
        # NumPy 2 would write its own integers in a way that it does not read.
        "shape": tuple(map(int, shape)),
    }
    with open(path, "wb") as stream:
        np.lib.format.write_array_header_1_0(stream, header)
        stream.flush()
        size = math.prod(shape) * np.dtype(dtype).itemsize
        if size and hasattr(os, "posix_fallocate"):  # macOS has no such call
            os.posix_fallocate(stream.fileno(), stream.tell(), size)
        else:
            stream.truncate(stream.tell() + size)
    return np.lib.format.open_memmap(path, mode="r+")


class ArrayFiles:
    """Arrays `{key}.npy` of a folder, together larger than memory perhaps, filled part by part.

    Args:
        layouts: key -> type and shape; the first axis is that of the parts.

    Attributes:
        arrays: by key, memory-mapped, zero where no part has come to.
    """

    def __init__(self, folder: Path, layouts: Mapping[str, tuple[type, tuple[int, ...]]]) -> None:
        self.arrays = {
            key: create_array(folder / f"{key}.npy", *layout) for key, layout in layouts.items()
        }
        self._filled = dict.fromkeys(layouts, 0)

    def append(self, **parts: np.ndarray) -> None:
        """Put parts behind those that are there."""
        for key, part in parts.items():
            start, self._filled[key] = self._filled[key], self._filled[key] + len(part)
            self.arrays[key][start : self._filled[key]] = part

    def flush(self) -> None:
        """Bring what was put in to the disk."""
        for array in self.arrays.values():
            array.flush()


def save_npz(path: str | Path, **arrays: Any) -> None:
    """Write arrays, strings and numbers to an `.npz`, without pickling anything.

    Those that shrink are compressed; coordinates hardly do, and it takes long to try.
    """
    for name, value in arrays.items():
        if np.asarray(value).dtype == object:
            raise TypeError(f"{path}: '{name}' is an object array, which would have to be pickled")
    # As NumPy does, which on a full disk leaves an archive that complains once more on its own.
    with atomic_file(path) as scratch, zipfile.ZipFile(scratch, "w") as held:
        for name, value in arrays.items():
            array, member = np.asanyarray(value), zipfile.ZipInfo(f"{name}.npy")
            member.compress_type = zipfile.ZIP_DEFLATED if _shrinks(array) else zipfile.ZIP_STORED
            with held.open(member, "w", force_zip64=True) as stream:
                np.lib.format.write_array(stream, array, allow_pickle=False)


_STRETCHES, _STRETCH_BYTES = 8, 8192  # of a large array, that tell whether all of it shrinks


def _shrinks(array: np.ndarray) -> bool:
    """Whether an array is worth compressing; small ones always are."""
    stretch = max(_STRETCH_BYTES // max(array.itemsize, 1), 1)
    if array.size <= _STRETCHES * stretch:
        return True
    values = array.ravel(order="K")  # without a copy, also of an array in Fortran's order
    starts = np.linspace(0, array.size - stretch, _STRETCHES).astype(int)
    sample = b"".join(values[start : start + stretch].tobytes() for start in starts)
    return len(zlib.compress(sample)) < 0.85 * len(sample)


class _Arrays(dict[str, np.ndarray]):
    """Arrays of a file; one that is missing is named together with the file."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path

    def __missing__(self, key: str) -> None:
        raise DamagedFile(self._path, f"lacks {key}; it holds {', '.join(sorted(self))}")


def load_npz(
    path: str | Path, table: Mapping[str, str], *, unread: Collection[str] = (), **sizes: int
) -> dict[str, np.ndarray]:
    """Read declared arrays of an `.npz`, without executing anything in it.

    Sizes are compared with the file's before memory is taken: a header that lies costs nothing.

    Args:
        table: key -> kind and axes, such as "float n 72"; see `drapeline.npy.Declared`. A key that
            ends in "?" may be missing, and one with a "*" is a pattern of any number of keys. What
            is not in the table is not read.
        unread: keys of which only the shape is wanted; zeros that take no memory stand for them.
        sizes: of axes that are known.

    Returns:
        The arrays in the file's order, half-precision ones converted to single precision. To ask
        for one that is not there is an InputError.

    Raises:
        InputError: the file is missing, unreadable, lacks an array, or one is not as declared, too
            large for its file, or holds pickles, fields, NaN or infinity.
    """
    path = Path(path)
    with _members(path, table) as (archive, members):
        _refuse_bomb(path, members.values())
        forms = {key: form for key in members if (form := _form_of(key, table)) is not None}
        declared, arrays = Declared(sizes), _Arrays(path)
        for key, info in members.items():
            whole = key not in unread and info.file_size <= _SMALL
            with _naming(path, key), _open_member(archive, info, whole) as stream:
                header = _checked_header(stream, info)
                declared.check_header(forms[key], header)
                if key in unread:
                    arrays[key] = np.broadcast_to(np.zeros((), header.dtype), header.shape)
                else:
                    arrays[key] = _whole(read_array(stream, header))
        for key, array in arrays.items():
            with _naming(path, key):
                declared.check_values(forms[key], array)
    return arrays


def _whole(array: np.ndarray) -> np.ndarray:
    """An array in single precision if it was stored in half."""
    return array.astype(np.float32) if array.dtype == np.float16 else array


_PLAIN = {str: "str", int: "int", float: "number", bool: "bool", tuple[str, ...]: "str *"}


def forms_of(record: type) -> dict[str, str]:
    """Key -> kind and axes of what a record's file holds, by the annotations of its fields.

    Arrays are annotated as in `Annotated[np.ndarray, "float n 72"]`, see `load_npz`. Other fields
    are texts, numbers, truth values, or records whose fields stand beside the others.
    """
    forms: dict[str, str] = {}
    for name, hint in get_type_hints(record, include_extras=True).items():
        if isinstance(hint, type) and is_dataclass(hint):
            forms |= forms_of(hint)
        else:
            forms[name] = get_args(hint)[1] if get_origin(hint) is Annotated else _PLAIN[hint]
    return forms


def save_record(path: str | Path, record: Any, **instead: Any) -> None:
    """Write a dataclass as `.npz`, some values `instead` of its own."""
    save_npz(path, **_flat(record) | instead)


def _flat(record: Any) -> dict[str, Any]:
    values = {field.name: getattr(record, field.name) for field in fields(record)}
    parts = [name for name, value in values.items() if is_dataclass(value)]
    for name in parts:
        values |= _flat(values.pop(name))
    return values


def load_record(path: str | Path, record: type[Record], **instead: str) -> Record:
    """Read what `save_record` wrote, some keys in other forms `instead` of the annotated ones.

    Raises:
        InputError: see `load_npz`.
    """
    return _of_arrays(record, load_npz(path, forms_of(record) | instead))


def _of_arrays(record: type[Record], arrays: Mapping[str, np.ndarray]) -> Record:
    values: dict[str, Any] = {}
    for name, hint in get_type_hints(record).items():
        if isinstance(hint, type) and is_dataclass(hint):
            values[name] = _of_arrays(hint, arrays)
        elif get_origin(hint) is tuple:
            values[name] = tuple(map(str, arrays[name]))
        else:
            values[name] = arrays[name] if hint is np.ndarray else hint(arrays[name])
    return record(**values)


@contextmanager
def _members(
    path: Path, table: Mapping[str, str]
) -> Iterator[tuple[zipfile.ZipFile, dict[str, zipfile.ZipInfo]]]:
    """An open `.npz` and its members that a table names, by their keys."""
    required = [key for key in table if not key.endswith("?") and "*" not in key]
    if not path.is_file():
        raise DamagedFile(path, f"no such file, expected an .npz with {', '.join(required)}")
    with refuse_damage(path, "an .npz of plain arrays"), zipfile.ZipFile(path) as archive:
        held = {
            info.filename[: -len(".npy")]: info
            for info in archive.infolist()
            if info.filename.endswith(".npy")
        }
        missing = [key for key in required if key not in held]
        if missing:
            raise DamagedFile(
                path, f"lacks {', '.join(missing)}; it holds {', '.join(sorted(held))}"
            )
        yield archive, {key: held[key] for key in held if _form_of(key, table) is not None}


def _form_of(key: str, table: Mapping[str, str]) -> str | None:
    for name in (key, f"{key}?"):
        if name in table:
            return table[name]
    patterns = (name for name in table if "*" in name)
    return next((table[name] for name in patterns if fnmatchcase(key, name)), None)


@contextmanager
def _naming(path: Path, key: str) -> Iterator[None]:
    try:
        yield
    except HeaderError as error:
        raise DamagedFile(path, f"'{key}' {error}") from error


_SMALL = 1 << 16


def _open_member(archive: zipfile.ZipFile, info: zipfile.ZipInfo, whole: bool) -> io.BufferedIOBase:
    # Other methods need memory that the file does not tell.
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise HeaderError("is packed in a way that NumPy does not use")
    # It can read into an array, which no annotation of `zipfile` says.
    stream = cast(io.BufferedIOBase, archive.open(info))
    if not whole:
        return stream
    with stream:  # read at once, which is faster than in pieces
        return io.BytesIO(stream.read(info.file_size))


def _checked_header(stream: io.BufferedIOBase, info: zipfile.ZipInfo) -> Header:
    header = read_header(stream)
    if header.size + header.nbytes != info.file_size:
        raise HeaderError(
            f"has {info.file_size} bytes, expected {header.size + header.nbytes} as its header says"
        )
    return header


# Zeros are packed a thousandfold. Honest files hold arrays of zeros too, but not much else than
# images of few pixels, which are packed a hundredfold, grows large.
_ANY_SIZE, _MOST_PACKED = 128 << 20, 256


def _refuse_bomb(path: Path, members: Iterable[zipfile.ZipInfo]) -> None:
    unpacked, size = sum(info.file_size for info in members), path.stat().st_size
    if unpacked > _ANY_SIZE + _MOST_PACKED * size:
        raise DamagedFile(
            path,
            f"{size} bytes that unpack to {unpacked}, expected at most {_MOST_PACKED} times"
            " as many",
        )


# Letters as in ASCII: file systems and patterns differ about all others.
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")
NAME_RULE = "up to 100 letters, digits, '_', '-' and '.', the first a letter or digit"


def check_name(name: str, where: str) -> None:
    """Refuse a name that may not become part of paths and patterns; files may be called anything.

    Args:
        where: file and entry that the name is from, for the message.

    Raises:
        InputError: the name is not as `NAME_RULE` says.
    """
    if not _NAME.fullmatch(name):
        raise InputError(f"{where} is '{name:.100}', expected {NAME_RULE}")


def write_json(path: str | Path, value: Any) -> None:
    """Write JSON at full precision; NaN is refused because JSON cannot express it."""
    with atomic_file(path) as scratch:
        scratch.write_text(json.dumps(value, indent=2, allow_nan=False) + "\n")


def read_json(path: str | Path, form: Any = object) -> Any:
    """Read JSON.

    Args:
        form: what it should be: a type (float stands for any number, object for anything), a tuple
            of the words that are allowed, a list of one form for lists of such values or of several
            for one value each, or a dict of forms for the keys it must have; keys that end in "?"
            may be missing.

    Raises:
        InputError: the file is missing, is not JSON, or is not of this form.
    """
    path = Path(path)
    with refuse_damage(path, "JSON"):
        value = parse_json(path.read_bytes().decode("utf-8-sig"))
        _check_form(path, value, form, "the file")
    return value


def parse_json(text: str) -> Any:
    """The value of a text of JSON.

    Raises:
        ValueError: it is not JSON, or a number is not finite or too large.
    """
    return json.loads(
        text, parse_constant=_refuse_constant, parse_float=_finite, parse_int=_bounded
    )


def _refuse_constant(word: str) -> None:
    raise ValueError(f"{word} is no number of JSON")


def _finite(text: str) -> float:
    number = float(text)
    if math.isinf(number):
        raise ValueError(f"{text} is too large")
    return number


def _bounded(text: str) -> int:
    number = int(text)
    if number.bit_length() > _INT_BITS:
        raise ValueError(f"{text:.20} is too large")
    return number


_INT_BITS = 63
_WORDS = {str: "text", float: "a number", int: "a whole number", bool: "true or false"}


def _check_form(path: Path, value: Any, form: Any, where: str) -> None:
    if isinstance(form, dict):
        _check_type(path, value, dict, where)
        for key, part in form.items():
            name = key.removesuffix("?")
            if name in value:
                _check_form(path, value[name], part, f"'{name}'")
            elif name == key:
                raise DamagedFile(path, f"{where} lacks '{name}'")
    elif isinstance(form, list):
        _check_type(path, value, list, where)
        if len(value) != len(form) > 1:
            raise DamagedFile(path, f"{where} has {len(value)} entries, expected {len(form)}")
        for item, part in zip(value, form if len(form) > 1 else form * len(value), strict=True):
            _check_form(path, item, part, f"an entry of {where}")
    elif isinstance(form, tuple):
        if value not in form:
            raise DamagedFile(path, f"{where} is {value!r:.100}, expected {' or '.join(form)}")
    else:
        _check_type(path, value, form, where)


def _check_type(path: Path, value: Any, form: type, where: str) -> None:
    is_number = form in (int, float) and isinstance(value, bool)
    if is_number or not isinstance(value, (int, float) if form is float else form):
        expected = _WORDS.get(form, "entries by name" if form is dict else "a list")
        raise DamagedFile(path, f"{where} is {value!r:.100}, expected {expected}")


MOST_TEXT_BYTES = 1 << 28


def read_text(path: str | Path, expected: str, *, most_bytes: int = MOST_TEXT_BYTES) -> str:
    """Text in UTF-8.

    Raises:
        InputError: the file is missing, is larger than `most_bytes`, or is no such text; names the
            line.
    """
    with refuse_damage(path, expected), open(path, "rb", buffering=0) as stream:
        size = os.fstat(stream.fileno()).st_size
        if size > most_bytes:
            raise InputError(
                f"{path}: {size:,} bytes, expected {expected} of at most {most_bytes:,}"
            )
        raw = stream.read()
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise DamagedFile(
            path,
            f"line {line} is not UTF-8 text (byte 0x{raw[error.start]:02x}), expected {expected} in"
            " UTF-8",
        ) from error
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise DamagedFile(path, f"line {line} holds a zero byte, expected {expected}")
    return text


def read_rows(path: str | Path, expected: str) -> tuple[list[str], list[dict[str, str]]]:
    """Heading and rows of a tab-separated table; fields that are missing at a row's end are empty.

    Raises:
        InputError: the file is missing, is no text, names a column twice, or has a row with more
            fields than the heading.
    """
    if not Path(path).is_file():
        raise DamagedFile(path, f"no such file, expected {expected}")
    text = read_text(path, expected)
    with refuse_damage(path, expected):
        lines = csv.reader(io.StringIO(text, newline=""), delimiter="\t")
        heading = next(lines, [])
        if len(set(heading)) < len(heading):
            raise DamagedFile(path, "a column is there twice, expected each name once")
        rows = []
        for fields in filter(None, lines):
            if len(fields) > len(heading):
                raise DamagedFile(
                    path,
                    f"line {lines.line_num} has {len(fields)} fields, expected {len(heading)} as in"
                    " the heading",
                )
            rows.append(dict(zip_longest(heading, fields, fillvalue="")))
    return heading, rows


def write_rows(
    path: str | Path, rows: Sequence[Mapping[str, Any]], columns: Iterable[str] = ()
) -> None:
    """Write a tab-separated table; line breaks and tabs within a value become spaces.

    Decimal numbers have six digits; NaN is left empty.

    Args:
        path: the `.tsv`.
        rows: column -> value; what a row lacks is empty.
        columns: the first ones, whether or not there are rows; others follow in order of
            appearance.
    """
    names = list(dict.fromkeys((*columns, *(name for row in rows for name in row))))
    with atomic_file(path) as scratch, open(scratch, "w", newline="") as stream:
        writer = csv.writer(stream, delimiter="\t", lineterminator="\n")
        writer.writerow(names)
        for row in rows:
            writer.writerow([" ".join(_cell(row.get(name, "")).split()) for name in names])


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.6g}"
    return str(value)
