"""Body files in SMPL's format, baked or licensed, read without executing anything in them.

SMPL is distributed as Python pickles, and a pickle is a program. Here only the few instructions
that build arrays and sparse matrices are carried out; all others are refused by name. Old files
wrap their arrays in objects of the package chumpy, which no longer installs: the arrays are taken
out without it.
"""

import io
import math
import pickle
import pickletools
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix

from drapeline.errors import InputError, refuse_damage
from drapeline.frames import JOINT_NAMES, PARENTS
from drapeline.npy import plain_dtype
from drapeline.storage import atomic_file, load_npz

# Instructions that no file of arrays has: objects by number, by class (protocol 0), out of band.
_UNKNOWN = {"PERSID", "INST", "OBJ", "EXT1", "EXT2", "EXT4", "NEXT_BUFFER", "READONLY_BUFFER"}
_KEEPS = {"PUT", "BINPUT", "LONG_BINPUT"}
_GETS = {"GET", "BINGET", "LONG_BINGET"}
_NUMBERED = _KEEPS | _GETS
_IN_TEXT = {"PUT", "GET"}
_ADDS = {"APPEND", "APPENDS", "SETITEM", "SETITEMS", "ADDITEMS", "BUILD"}
_LENGTH_BYTES = {
    pickletools.TAKEN_FROM_ARGUMENT1: 1,
    pickletools.TAKEN_FROM_ARGUMENT4: 4,
    pickletools.TAKEN_FROM_ARGUMENT4U: 4,
    pickletools.TAKEN_FROM_ARGUMENT8U: 8,
}
_TWO_LINES = {"GLOBAL"}
# Objects that may be walked through in all, and as many more for each byte of the pickle.
_MOST_WALKED, _MOST_PER_BYTE = 1 << 24, 16


class _Instruction(NamedTuple):
    name: str
    size: int  # of its argument: bytes, or pickletools' number for a kind of size
    takes: int  # objects from the stack, beside those above a mark
    to_mark: bool
    gives: bool


def _instruction(one: pickletools.OpcodeInfo) -> _Instruction:
    before = [kind.name for kind in one.stack_before]
    marked = "mark" in before
    takes = len(before) - (2 if marked else 0)
    return _Instruction(
        one.name, 0 if one.arg is None else one.arg.n, takes, marked, bool(one.stack_after)
    )


_INSTRUCTIONS = {
    ord(one.code): _instruction(one) for one in pickletools.opcodes if one.name not in _UNKNOWN
}


class _Made:
    """An object: how many objects are met in a walk through it."""

    __slots__ = ("size",)

    def __init__(self, size: int) -> None:
        self.size = size


class _Stack:
    """The stack of Python's reader, with sizes in place of objects.

    A tuple that holds a tuple twice, which holds another twice, and so on, takes few bytes, but
    with each of them twice as long to walk through, as Python does to find it among keys.
    """

    def __init__(self, most: int) -> None:
        self._left = most
        self._objects: list[_Made | None] = []  # None is a mark
        self._kept: dict[int, _Made | None] = {}

    def carry_out(self, one: _Instruction, index: int, size: int) -> None:
        """Carry out an instruction that names the kept object `index` or has `size` bytes."""
        objects, name = self._objects, one.name
        if name == "MARK":
            objects.append(None)
        elif name == "DUP":
            objects.append(objects[-1])
        elif name == "POP":
            objects.pop()
        elif name == "MEMOIZE":
            self._kept[len(self._kept)] = objects[-1]
        elif name in _KEEPS:
            self._kept[index] = objects[-1]
        elif name in _GETS:
            objects.append(self._kept[index])
        else:
            self._make(one, size)

    def _make(self, one: _Instruction, size: int) -> None:
        objects, walked = self._objects, 0
        if one.to_mark:
            while (above := objects.pop()) is not None:
                walked += above.size
        for _ in range(one.takes - (one.name in _ADDS)):
            walked += self._take().size
        self._left -= walked
        if self._left < 0:
            raise ValueError("its objects hold one another too often")
        if one.name in _ADDS:
            held = self._take()
            held.size += walked
            objects.append(held)
        elif one.gives:
            objects.append(_Made(1 + size // 8 + walked))

    def _take(self) -> _Made:
        """The topmost object."""
        made = self._objects.pop()
        if made is None:
            raise LookupError("a mark, not an object")
        return made


def pickle_end(data: bytes, start: int = 0) -> int:
    """End of the pickle that starts there.

    Raises:
        ValueError: an instruction is unknown or cut off, asks for more bytes than there are, for
            an object that is not there, or counts objects that it has not made; or objects hold
            one another so often that a walk through them would not end.
    """
    stack = _Stack(_MOST_WALKED + _MOST_PER_BYTE * (len(data) - start))
    for count, (one, begin, end) in enumerate(_instructions(data, start)):
        index = 0
        if one.name in _NUMBERED:
            argument = data[begin:end]
            text = one.name in _IN_TEXT
            index = int(argument[:20]) if text else int.from_bytes(argument, "little")
            if not 0 <= index <= count:
                raise ValueError(f"object {index} is kept, after {count} instructions")
        elif one.name == "FRAME":
            size = int.from_bytes(data[begin:end], "little")
            if size > len(data) - end:
                raise ValueError(f"a frame of {size} bytes, {len(data) - end} are left")
        elif one.name == "STOP":
            return end
        try:
            stack.carry_out(one, index, end - begin)
        except LookupError:
            raise ValueError(
                f"{one.name} at byte {begin - 1} asks for an object that is not there"
            ) from None
    raise ValueError("it is cut off")


def _instructions(data: bytes, place: int) -> Iterator[tuple[_Instruction, int, int]]:
    """Instructions, and where their arguments start and end."""
    while place < len(data):
        instruction = _INSTRUCTIONS.get(data[place])
        if instruction is None:
            raise ValueError(f"byte {place} is no instruction of a file of arrays")
        name, size = instruction.name, instruction.size
        place += 1
        if size == pickletools.UP_TO_NEWLINE:
            end = data.index(b"\n", place) + 1
            if name in _TWO_LINES:
                end = data.index(b"\n", end) + 1
        elif size < 0:
            width = _LENGTH_BYTES[size]
            end = place + width + int.from_bytes(data[place : place + width], "little")
        else:
            end = place + size
        if end > len(data):
            raise ValueError(
                f"{name} at byte {place - 1} asks for {end - len(data)} bytes too many"
            )
        yield instruction, place, end
        place = end


COMPONENTS = 10
REQUIRED = ("v_template", "shapedirs", "posedirs", "J_regressor", "weights", "kintree_table", "f")
OPTIONAL = ("vt", "ft", "segmentation", "name")


def read_body_arrays(path: str | Path) -> dict[str, np.ndarray]:
    """Read the arrays of a body file, `.npz` or `.pkl`, and check that they fit together.

    Returns:
        v_template (V, 3), shapedirs (V, 3, 10), posedirs (V, 3, 207), J_regressor (24, V) and
        weights (V, 24) as float32, kintree_table (2, 24) as int64, f (F, 3) and segmentation
        (V,) as int32, name, and where the file has them vt (T, 2) float32 and ft (F, 3) int32.

    Raises:
        InputError: names the file and what in it is missing, forbidden or misshapen.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected a body model (.npz or .pkl)")
    readers = {".npz": _read_npz, ".pkl": _read_pickle}
    if path.suffix not in readers:
        raise InputError(f"{path}: a '{path.suffix}' file, expected a body model (.npz or .pkl)")
    found = readers[path.suffix](path)
    missing = [key for key in REQUIRED if key not in found]
    if missing:
        raise InputError(f"{path}: lacks {', '.join(missing)}, which an SMPL body has")
    arrays = {key: _plain(path, key, found[key]) for key in REQUIRED + OPTIONAL if key in found}
    _check(path, arrays)
    return _tidy(path, arrays)


def convert_to_pickle(source: str | Path, target: str | Path) -> None:
    """Write a body file as the plain pickle that `smplx.SMPL` and other SMPL tools open.

    Raises:
        InputError: as `read_body_arrays`.
    """
    arrays = read_body_arrays(source)
    with atomic_file(target) as scratch, open(scratch, "wb") as stream:
        pickle.dump(arrays, stream, protocol=2)


def _read_npz(path: Path) -> dict[str, Any]:
    # Only what is needed: SMPL's own files also hold pickled tables.
    return load_npz(path, {f"{key}?": "any|nan ..." for key in REQUIRED + OPTIONAL})


class _Inert:
    """Stands for an object of the file: keeps its class's name and its state, does nothing."""

    origin = ""

    def __init__(self, *arguments: Any) -> None:
        self.state: dict[str, Any] = {}

    def __setstate__(self, state: Any) -> None:
        if isinstance(state, dict):
            self.state = state


def _inert_class(origin: str) -> type:
    return type("Inert", (_Inert,), {"origin": origin})


class _Dtype:
    """A type of numbers by its name, such as "f8"; what else a pickle says of it is not heeded."""

    def __init__(self, name: Any, *_: Any) -> None:
        if not isinstance(name, str):
            raise pickle.UnpicklingError("a type of numbers without a name")
        self.name, self.order = name, ""

    def __setstate__(self, state: Any) -> None:
        order = state[1]
        if order not in ("<", ">", "=", "|"):
            raise pickle.UnpicklingError("a type of numbers in no known order of bytes")
        self.order = order
        if self.name[:1] == "U":  # the length of text is told apart
            self.name = f"U{int(state[5]) // 4}"


class _Array:
    """An array of the file: what the pickle tells of it, made an array when it is asked for."""

    def __init__(self, *_: Any) -> None:
        self.pieces: tuple[Any, ...] = ()

    def __setstate__(self, state: Any) -> None:
        _version, shape, dtype, fortran, raw = state
        self.pieces = (shape, dtype, fortran, raw)

    def array(self) -> np.ndarray:
        """The numbers or the text.

        Raises:
            ValueError: the pieces do not fit together, or are no numbers and no text.
        """
        shape, dtype, fortran, raw = self.pieces
        if isinstance(raw, str):  # as Python 2 wrote bytes
            raw = raw.encode("latin1")
        if not isinstance(dtype, _Dtype) or not isinstance(raw, bytes | bytearray):
            raise ValueError("no numbers")
        if not isinstance(shape, tuple) or not all(isinstance(n, int) and n >= 0 for n in shape):
            raise ValueError("no shape")
        plain = plain_dtype(dtype.order.replace("|", "") + dtype.name)
        if math.prod(shape) * plain.itemsize != len(raw):
            raise ValueError(f"{len(raw)} bytes in an array of shape {shape}")
        flat = np.frombuffer(raw, plain) if raw else np.zeros(0, plain)
        return flat.reshape(shape, order="F" if fortran else "C")


def _reconstruct(cls: Any, *_: Any) -> _Array:
    """Make an empty array, whose state follows."""
    if cls is not _Array:
        raise pickle.UnpicklingError("an array of another class")
    return _Array()


def _scalar(dtype: Any, raw: Any) -> _Array:
    made = _Array()
    made.pieces = ((), dtype, False, raw)
    return made


def _frombuffer(raw: Any, dtype: Any, shape: Any, order: Any) -> _Array:
    """Make an array as protocol 5 does."""
    made = _Array()
    made.pieces = (shape, dtype, order == "F", raw)
    return made


def _reconstructor(cls: Any, base: Any, state: Any) -> _Inert:
    """Make a stand-in for the empty object that old pickles ask for."""
    if not (isinstance(cls, type) and issubclass(cls, _Inert)):
        raise pickle.UnpicklingError("an object that is no array")
    return cls()


def _encode(text: str, encoding: str = "latin1") -> bytes:
    """`_codecs.encode`, with which protocol 2 writes bytes; no other codec is let in."""
    if encoding not in ("latin1", "latin-1"):
        raise pickle.UnpicklingError(f"text in the codec {encoding}")
    return text.encode("latin1")


def _no_bytes() -> bytes:
    """`bytes()`, with which protocol 2 writes those of an empty array."""
    return b""


_NUMPY_MODULES = ("numpy", "numpy.core.multiarray", "numpy._core.multiarray")
_NUMERIC_MODULES = ("numpy.core.numeric", "numpy._core.numeric")
_BUILTINS = ("__builtin__", "builtins")
_HARMLESS = {
    **{(m, "_reconstruct"): _reconstruct for m in _NUMPY_MODULES},
    **{(m, "scalar"): _scalar for m in _NUMPY_MODULES},
    **{(m, "_frombuffer"): _frombuffer for m in _NUMERIC_MODULES},
    ("numpy", "ndarray"): _Array,
    ("numpy", "dtype"): _Dtype,
    ("_codecs", "encode"): _encode,
    **{(m, "_reconstructor"): _reconstructor for m in ("copy_reg", "copyreg")},
    **{(m, kind.__name__): kind for m in _BUILTINS for kind in (object, set, frozenset)},
    **{(m, "bytes"): _no_bytes for m in _BUILTINS},
}


class _Refused(Exception):
    """The file asks for something that is not an array."""


class _ArrayUnpickler(pickle.Unpickler):
    """Knows arrays, sparse matrices and chumpy objects, all as inert stand-ins."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) in _HARMLESS:
            return _HARMLESS[module, name]
        package = module.split(".")[0]
        is_sparse = module.startswith("scipy.sparse") and name in ("csc_matrix", "csr_matrix")
        if package == "chumpy" or is_sparse:
            return _inert_class(f"{module}.{name}")
        raise _Refused(f"{module}.{name}")


def _read_pickle(path: Path) -> dict[str, Any]:
    with refuse_damage(path, "a pickle of arrays"):
        data = path.read_bytes()
        pickle_end(data)
        try:
            # Written by Python 2, whose strings are bytes.
            found = _ArrayUnpickler(io.BytesIO(data), encoding="latin1").load()
        except _Refused as refused:
            raise InputError(
                f"{path}: asks Python to run or build '{refused}', expected arrays and sparse"
                " matrices only; the file was not opened further"
            ) from refused
    if not isinstance(found, dict):
        raise InputError(f"{path}: holds a {type(found).__name__}, expected a table of arrays")
    return found


def _plain(path: Path, key: str, value: Any) -> np.ndarray:
    """A dense array of numbers, or text, out of whatever the file held."""
    try:
        value = _unwrap(value)
    except (LookupError, AttributeError, TypeError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: '{key}' is a damaged {_kind(value)}") from error
    # Not a list: a list of the same list twice, and so on, is an array without end.
    if not isinstance(value, np.ndarray | str | int | float):
        raise InputError(f"{path}: '{key}' is a {_kind(value)}, expected an array")
    return np.asarray(value)


def _kind(value: Any) -> str:
    if isinstance(value, _Array):
        return "array"
    return value.origin if isinstance(value, _Inert) else type(value).__name__


_MOST_DENSE = 8 << 20  # numbers of a sparse matrix that is made dense


def _unwrap(value: Any) -> Any:
    if isinstance(value, _Array):
        return value.array()
    if not isinstance(value, _Inert):
        return value
    name = value.origin.rsplit(".", 1)[1]
    state = value.state
    if name in ("csc_matrix", "csr_matrix"):
        build = {"csc_matrix": csc_matrix, "csr_matrix": csr_matrix}[name]
        rows, columns = (int(n) for n in state["_shape" if "_shape" in state else "shape"])
        if rows * columns > _MOST_DENSE:
            raise ValueError(f"a matrix of {rows} x {columns}")
        parts = tuple(_entries(state[key]) for key in ("data", "indices", "indptr"))
        matrix = build(parts, shape=(rows, columns))
        matrix.check_format(full_check=True)
        return matrix.toarray()
    if name == "Ch":
        return _unwrap(state["x"])
    if name == "Select":  # entries of a flattened array, in a new shape
        chosen = _entries(state["a"]).ravel()[_entries(state["idxs"])]
        return chosen.reshape(state.get("preferred_shape", chosen.shape))
    return value


def _entries(value: Any) -> np.ndarray:
    array = _unwrap(value)
    if not isinstance(array, np.ndarray):
        raise ValueError(f"a {_kind(value)} in place of an array")
    return array


def _check(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Refuse arrays that do not fit together.

    Raises:
        InputError: the first mismatch, with the shape found and expected.
    """
    template = arrays["v_template"]
    count = len(template) if template.ndim else 0
    expected = {
        "v_template": (count, 3),
        "shapedirs": (count, 3, COMPONENTS),
        "posedirs": (count, 3, 207),
        "J_regressor": (24, count),
        "weights": (count, 24),
        "kintree_table": (2, 24),
    }
    for key, shape in expected.items():
        found = arrays[key].shape
        longer = key == "shapedirs" and found[:2] == shape[:2] and found[2:] >= shape[2:]
        if found != shape and not longer:
            raise InputError(f"{path}: '{key}' has shape {found}, expected {shape}")
        if arrays[key].dtype.kind not in "fiu" or not np.isfinite(arrays[key]).all():
            raise InputError(f"{path}: '{key}' holds values that are not finite numbers")
    _check_faces(path, "f", arrays["f"], count)
    _check_person(path, arrays)
    if {"vt", "ft"} <= arrays.keys():
        points = arrays["vt"]
        if points.ndim != 2 or points.shape[1] != 2 or points.dtype.kind not in "fiu":
            raise InputError(f"{path}: 'vt' has shape {points.shape}, expected (points, 2) numbers")
        if not np.isfinite(points).all():
            raise InputError(f"{path}: 'vt' holds values that are not finite numbers")
        _check_faces(path, "ft", arrays["ft"], len(points))
        if len(arrays["ft"]) != len(arrays["f"]):
            raise InputError(
                f"{path}: 'ft' has {len(arrays['ft'])} faces, expected {len(arrays['f'])} like 'f'"
            )
    parts = arrays.get("segmentation", np.zeros(count, np.int32))
    fits = parts.shape == (count,) and parts.dtype.kind in "iu"
    if not fits or parts.min(initial=0) < 0 or parts.max(initial=0) >= len(PARENTS):
        raise InputError(f"{path}: 'segmentation' is not the joint, 0 to 23, of {count} vertices")
    if not np.array_equal(arrays["kintree_table"][0, 1:].astype(np.int64), PARENTS[1:]):
        raise InputError(f"{path}: 'kintree_table' is not SMPL's tree of 24 joints")
    total = arrays["weights"].sum(axis=1)
    if count and np.abs(total - 1).max() > 1e-3:
        worst = int(np.abs(total - 1).argmax())
        raise InputError(
            f"{path}: 'weights' of vertex {worst} sum to {total[worst]:.3f}, expected 1"
        )
    least, most = arrays["weights"].min(initial=0), arrays["weights"].max(initial=0)
    if least < -_WEIGHT_SLACK or most > 1 + _WEIGHT_SLACK:
        raise InputError(f"{path}: 'weights' are from {least:.3g} to {most:.3g}, expected 0 to 1")


_TALL_M = (1.0, 2.5)
_WEIGHT_SLACK = 1e-3


def _check_person(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Refuse what is no person in metres, upright along Y, with the left side at positive X."""
    template = arrays["v_template"]
    tall = float(np.ptp(template[:, 1])) if len(template) else 0.0
    if not _TALL_M[0] <= tall <= _TALL_M[1]:
        raise InputError(
            f"{path}: 'v_template' is {tall:.4g} tall along Y, expected a person, {_TALL_M[0]:g} to"
            f" {_TALL_M[1]:g} m"
        )
    joints = arrays["J_regressor"] @ template
    place = {name: joints[JOINT_NAMES.index(name)] for name in ("left_hip", "right_hip", "head")}
    if place["left_hip"][0] <= place["right_hip"][0]:
        raise InputError(f"{path}: the left hip is not at the left, positive X; is it mirrored?")
    if place["head"][1] <= place["left_hip"][1]:
        raise InputError(f"{path}: the head is below the hips, expected Y upwards")


def _check_faces(path: Path, key: str, faces: np.ndarray, count: int) -> None:
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise InputError(
            f"{path}: '{key}' has shape {faces.shape}, expected (faces, 3) whole numbers"
        )
    least, last = int(faces.min(initial=0)), int(faces.max(initial=0))
    if least < 0 or last >= count:
        wrong = least if least < 0 else last
        raise InputError(f"{path}: '{key}' names vertex {wrong}, expected 0 to {count - 1}")


def _tidy(path: Path, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    out = {
        key: _float32(arrays[key]) for key in ("v_template", "posedirs", "J_regressor", "weights")
    }
    out["shapedirs"] = _float32(arrays["shapedirs"][..., :COMPONENTS])
    out["kintree_table"] = arrays["kintree_table"].astype(np.int64)
    out["f"] = arrays["f"].astype(np.int32)
    if "vt" in arrays and "ft" in arrays:
        out["vt"], out["ft"] = arrays["vt"].astype(np.float32), arrays["ft"].astype(np.int32)
    parts = arrays.get("segmentation", arrays["weights"].argmax(axis=1))
    out["segmentation"] = parts.astype(np.int32)
    out["name"] = np.asarray(arrays.get("name", path.stem))
    return out


def _float32(array: np.ndarray) -> np.ndarray:
    """Contiguous and ours to change, which the bytes of a pickle are not."""
    return np.require(array, np.float32, ["C", "W"])
