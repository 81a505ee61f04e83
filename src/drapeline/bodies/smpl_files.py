"""Body files in SMPL's format, baked or licensed, read without executing anything in them.

SMPL is distributed as Python pickles, and a pickle is a program. Here only the few instructions
that build arrays and sparse matrices are carried out; all others are refused by name. Old files
wrap their arrays in objects of the package chumpy, which no longer installs: the arrays are taken
out without it.
"""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix

from drapeline.errors import InputError
from drapeline.frames import PARENTS
from drapeline.storage import atomic_file, load_npz

try:
    from numpy._core import multiarray, numeric
except ImportError:  # NumPy 1
    from numpy.core import multiarray, numeric

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
        self.arguments = arguments

    def __setstate__(self, state: Any) -> None:
        if isinstance(state, dict):
            self.state = state


def _inert_class(origin: str) -> type:
    return type("Inert", (_Inert,), {"origin": origin})


def _reconstructor(cls: type, base: type, state: Any) -> _Inert:
    """What old pickles call to make an empty object; makes stand-ins only."""
    if not (isinstance(cls, type) and issubclass(cls, _Inert)):
        raise pickle.UnpicklingError("an object that is no array")
    return cls()


def _encode(text: str, encoding: str = "latin1") -> bytes:
    """`_codecs.encode`, with which protocol 2 writes bytes; no other codec is let in."""
    if encoding not in ("latin1", "latin-1"):
        raise pickle.UnpicklingError(f"text in the codec {encoding}")
    return text.encode("latin1")


_NUMPY_MODULES = ("numpy", "numpy.core.multiarray", "numpy._core.multiarray")
_NUMERIC_MODULES = ("numpy.core.numeric", "numpy._core.numeric")
_HARMLESS = {
    **{(m, "_reconstruct"): multiarray._reconstruct for m in _NUMPY_MODULES},
    **{(m, "scalar"): multiarray.scalar for m in _NUMPY_MODULES},
    **{(m, "_frombuffer"): numeric._frombuffer for m in _NUMERIC_MODULES},
    ("numpy", "ndarray"): np.ndarray,
    ("numpy", "dtype"): np.dtype,
    ("_codecs", "encode"): _encode,
    **{(m, "_reconstructor"): _reconstructor for m in ("copy_reg", "copyreg")},
    **{
        (m, kind.__name__): kind
        for m in ("__builtin__", "builtins")
        for kind in (object, set, frozenset)
    },
}


class _Refused(Exception):
    """The file asks for something that is not an array."""


class _ArrayUnpickler(pickle.Unpickler):
    """Builds arrays; knows sparse matrices and chumpy objects only as inert stand-ins."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) in _HARMLESS:
            return _HARMLESS[module, name]
        package = module.split(".")[0]
        is_sparse = module.startswith("scipy.sparse") and name in ("csc_matrix", "csr_matrix")
        if package == "chumpy" or is_sparse:
            return _inert_class(f"{module}.{name}")
        raise _Refused(f"{module}.{name}")


def _read_pickle(path: Path) -> dict[str, Any]:
    with open(path, "rb") as stream:
        try:
            # Written by Python 2, whose strings are bytes.
            found = _ArrayUnpickler(stream, encoding="latin1").load()
        except _Refused as refused:
            raise InputError(
                f"{path}: asks Python to run or build '{refused}', expected arrays and sparse"
                " matrices only; the file was not opened further"
            ) from refused
        except Exception as error:  # a damaged pickle can fail in any way
            raise InputError(f"{path}: not a readable pickle of arrays ({error})") from error
    if not isinstance(found, dict):
        raise InputError(f"{path}: holds a {type(found).__name__}, expected a table of arrays")
    return found


def _plain(path: Path, key: str, value: Any) -> np.ndarray:
    """A dense array of numbers, or text, out of whatever the file held."""
    try:
        value = _unwrap(value)
    except (KeyError, AttributeError, TypeError, ValueError, IndexError) as error:
        raise InputError(f"{path}: '{key}' is a damaged {_kind(value)}") from error
    array = np.asarray(value)
    if array.dtype == object or isinstance(value, _Inert):
        raise InputError(f"{path}: '{key}' is a {_kind(value)}, expected an array")
    return array


def _kind(value: Any) -> str:
    return value.origin if isinstance(value, _Inert) else type(value).__name__


def _unwrap(value: Any) -> Any:
    if not isinstance(value, _Inert):
        return value
    name = value.origin.rsplit(".", 1)[1]
    state = value.state
    if name in ("csc_matrix", "csr_matrix"):
        build = {"csc_matrix": csc_matrix, "csr_matrix": csr_matrix}[name]
        shape = state.get("_shape", state.get("shape"))
        matrix = build((state["data"], state["indices"], state["indptr"]), shape=shape)
        matrix.check_format(full_check=True)
        return matrix.toarray()
    if name == "Ch":
        return _unwrap(state["x"])
    if name == "Select":  # entries of a flattened array, in a new shape
        chosen = np.asarray(_unwrap(state["a"])).ravel()[np.asarray(state["idxs"])]
        return chosen.reshape(state.get("preferred_shape", chosen.shape))
    return value


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
    faces = arrays["f"]
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise InputError(f"{path}: 'f' has shape {faces.shape}, expected (faces, 3) whole numbers")
    if faces.min(initial=0) < 0 or faces.max(initial=0) >= count:
        raise InputError(f"{path}: 'f' names vertex {faces.max()}, expected 0 to {count - 1}")
    if not np.array_equal(arrays["kintree_table"][0, 1:].astype(np.int64), PARENTS[1:]):
        raise InputError(f"{path}: 'kintree_table' is not SMPL's tree of 24 joints")
    total = arrays["weights"].sum(axis=1)
    if count and np.abs(total - 1).max() > 1e-3:
        worst = int(np.abs(total - 1).argmax())
        raise InputError(
            f"{path}: 'weights' of vertex {worst} sum to {total[worst]:.3f}, expected 1"
        )


def _tidy(path: Path, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    out = {
        key: np.ascontiguousarray(arrays[key], dtype=np.float32)
        for key in ("v_template", "posedirs", "J_regressor", "weights")
    }
    out["shapedirs"] = np.ascontiguousarray(arrays["shapedirs"][..., :COMPONENTS], np.float32)
    out["kintree_table"] = arrays["kintree_table"].astype(np.int64)
    out["f"] = arrays["f"].astype(np.int32)
    if "vt" in arrays and "ft" in arrays:
        out["vt"], out["ft"] = arrays["vt"].astype(np.float32), arrays["ft"].astype(np.int32)
    parts = arrays.get("segmentation", arrays["weights"].argmax(axis=1))
    out["segmentation"] = parts.astype(np.int32)
    out["name"] = np.asarray(arrays.get("name", path.stem))
    return out
