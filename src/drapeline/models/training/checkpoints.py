"""Checkpoint files of trained networks; reading them executes nothing."""

import io
import math
import pickle
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import torch
from torch import nn

from drapeline.errors import DamagedFile, InputError, refuse_damage
from drapeline.pickles import pickle_end
from drapeline.storage import atomic_file

Network = TypeVar("Network", bound=nn.Module)
_EXPECTED = "a checkpoint of plain weights"
_STATE, _ABOUT = "state_dict", "drapeline"


def read_checkpoint(path: str | Path) -> dict[str, Any]:
    """A checkpoint as plain values and tensors.

    Its entry "drapeline" is what `TrainableModule.about` returned.

    Raises:
        InputError: the file is missing, is no checkpoint, lacks an entry, or holds weights that are
            not finite.
    """
    checkpoint = read_weights(path)
    about = checkpoint.get(_ABOUT) if isinstance(checkpoint, dict) else None
    if not isinstance(about, dict) or not isinstance(about.get("checkpoint_type"), str):
        raise DamagedFile(path, "not a checkpoint of drapeline, which has a 'drapeline' entry")
    state = checkpoint.get(_STATE)
    if not isinstance(state, dict) or not all(isinstance(x, torch.Tensor) for x in state.values()):
        raise DamagedFile(path, "lacks weights by name, expected them as 'state_dict'")
    _refuse_large_sizes(path, about, sum(x.numel() for x in state.values()))
    return checkpoint


@contextmanager
def building(path: str | Path) -> Iterator[None]:
    """Name the checkpoint that a network cannot be built from."""
    try:
        with refuse_damage(path, "a checkpoint of drapeline"):
            yield
    except InputError as error:
        if str(path) in str(error):
            raise
        raise DamagedFile(path, f"{error}") from error


def load_state(module: nn.Module, checkpoint: Mapping[str, Any], path: str | Path) -> None:
    """Load the weights of a checkpoint into a network.

    Raises:
        InputError: a weight is missing, unknown or of another shape.
    """
    try:
        module.load_state_dict(checkpoint[_STATE])
    except RuntimeError as error:
        reason = str(error).splitlines()[-1].strip()
        raise DamagedFile(path, f"its weights do not fit its network ({reason})") from error


def load_network(
    path: str | Path, kind: str, build: Callable[[Mapping[str, Any]], Network]
) -> Network:
    """A trained network, ready to predict.

    Args:
        path: of the checkpoint.
        kind: its `checkpoint_type`.
        build: makes the network from what its `about` gave.

    Raises:
        InputError: the checkpoint is missing, damaged, or of another kind of network.
    """
    checkpoint = read_checkpoint(path)
    about = checkpoint[_ABOUT]
    if about["checkpoint_type"] != kind:
        raise DamagedFile(path, f"holds a '{about['checkpoint_type']}' network, expected {kind}")
    with building(path):
        network = build(about)
    load_state(network, checkpoint, path)
    return network.eval().requires_grad_(False)


def _refuse_large_sizes(path: str | Path, about: Any, weights: int, name: str = "") -> None:
    """Refuse sizes of layers that no network with so few weights has, before it is built."""
    if isinstance(about, Mapping):
        for key, value in about.items():
            if key not in ("training", "seed"):
                _refuse_large_sizes(path, value, weights, str(key))
    elif isinstance(about, list | tuple):
        for value in about:
            _refuse_large_sizes(path, value, weights, name)
    elif isinstance(about, int | float) and not abs(about) <= max(weights, 10_000):
        raise DamagedFile(path, f"'{name}' is {about}, but it holds {weights} weights")


def read_weights(path: str | Path) -> Any:
    """Plain values and tensors that torch wrote.

    Raises:
        InputError: the file is missing, holds anything else, or numbers that are not finite.
    """
    path = Path(path)
    if not path.is_file():
        raise DamagedFile(path, "no such file, expected a checkpoint")
    with refuse_damage(path, _EXPECTED):
        if zipfile.is_zipfile(path):
            _check_zip(path)
        else:
            _check_pickles(path.read_bytes())
        try:
            found = torch.load(path, map_location="cpu", weights_only=True)
        except pickle.UnpicklingError as error:
            _refuse_objects(path, error)
    # What else a training keeps, such as the best loss before its first epoch, may be infinite.
    own = isinstance(found, dict) and {_STATE, _ABOUT} <= found.keys()
    _refuse_unfinite(path, [found[_STATE], found[_ABOUT]] if own else found, "")
    return found


def write_weights(path: str | Path, values: Any) -> None:
    """Write plain values and tensors as torch does, by way of memory.

    torch's own writer calls a full disk an internal error, and leaves half a file.

    Raises:
        InputError: the folder is not writable or the disk is full.
    """
    stream = io.BytesIO()
    torch.save(values, stream)
    with atomic_file(path) as scratch:
        scratch.write_bytes(stream.getbuffer())


def _refuse_objects(path: Path, error: Exception) -> NoReturn:
    """In other words than torch's, which say how to run what is in the file."""
    named = re.search(r"(?:GLOBAL|global|class) [`'\"]?([A-Za-z_][\w.]*)", str(error))
    what = f"'{named[1]}'" if named else "objects"
    raise DamagedFile(
        path,
        f"asks Python to run or build {what}, not readable as {_EXPECTED}; the file was not"
        " opened further",
    ) from None


def _refuse_unfinite(path: Path, value: Any, name: str) -> None:
    if isinstance(value, torch.Tensor):
        if value.is_floating_point() and not torch.isfinite(value).all():
            raise DamagedFile(path, f"'{name}' holds NaN or infinity, expected finite numbers")
    elif isinstance(value, Mapping):
        for key, inner in value.items():
            _refuse_unfinite(path, inner, str(key))
    elif isinstance(value, list | tuple):
        for inner in value:
            _refuse_unfinite(path, inner, name)


# ---- sizes, which torch's own reader takes on trust ------------------------------------------


class _Anything:
    """Stands for whatever a checkpoint names."""

    origin = ""

    def __init__(self, *arguments: Any) -> None:
        pass

    def __setstate__(self, state: Any) -> None:
        pass

    def __setitem__(self, key: Any, value: Any) -> None:
        pass

    def append(self, value: Any) -> None:
        """Nothing."""

    def extend(self, values: Any) -> None:
        """Nothing."""


_WIDTHS = {
    **{f"{name}Storage": 1 for name in ("Untyped", "Bool", "Byte", "Char")},
    **{f"{name}Storage": 2 for name in ("Half", "BFloat16", "Short")},
    **{f"{name}Storage": 4 for name in ("Float", "Int")},
    **{f"{name}Storage": 8 for name in ("Double", "Long", "ComplexFloat")},
}
_MOST_REPEATED = 1 << 24  # elements of a tensor whose storage is smaller, as of an expanded one


class _SizeReader(pickle.Unpickler):
    """Reads how large storages and tensors say they are.

    Attributes:
        storages: key -> bytes.
    """

    def __init__(self, data: bytes) -> None:
        super().__init__(io.BytesIO(data))
        self.storages: dict[str, int] = {}

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return self._tensor
        return type("Anything", (_Anything,), {"origin": name})

    def persistent_load(self, given: Any) -> int:
        """Number of elements of a storage."""
        _, kind, key, _, count, *_ = given
        width = _WIDTHS[kind.origin]
        if not isinstance(count, int) or count < 0:
            raise ValueError(f"a storage of {count} elements")
        self.storages[str(key)] = count * width
        return count

    def _tensor(self, count: Any, start: int, size: Any, stride: Any, *_: Any) -> None:
        total = math.prod(size)
        if min((start, *size, *stride)) < 0 or total > max(count, _MOST_REPEATED):
            raise ValueError(f"a tensor of {total} elements in a storage of {count}")


def _check_zip(path: Path) -> None:
    with zipfile.ZipFile(path) as archive:
        members = {info.filename.partition("/")[2]: info for info in archive.infolist()}
        size = path.stat().st_size
        for info in members.values():
            if info.compress_type != zipfile.ZIP_STORED or info.file_size > size:
                raise ValueError(f"{info.filename} has {info.file_size} bytes")
        data = archive.read(members["data.pkl"])
    pickle_end(data)
    reader = _SizeReader(data)
    reader.load()
    for key, wanted in reader.storages.items():
        if members[f"data/{key}"].file_size < wanted:
            raise ValueError(f"storage {key} has less than {wanted} bytes")


def _check_pickles(data: bytes) -> None:
    """The format before torch 1.6: pickles one after the other, then the storages."""
    place, total = 0, 0
    for _ in range(5):  # magic number, version, machine, content, keys of storages
        end = pickle_end(data, place)
        reader = _SizeReader(data[place:end])
        reader.load()
        total += sum(reader.storages.values())
        place = end
    if total > len(data) - place:
        raise ValueError(f"its storages have less than {total} bytes")
