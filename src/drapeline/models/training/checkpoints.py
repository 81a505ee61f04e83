"""Files of trained networks; reading them executes nothing.

What a training leaves for use is a safetensors file: the weights by name, and as its only entry of
metadata, "drapeline", a text of JSON with all that the network is built from. Arrays in there stand
among the weights, as `metadata/...`; the JSON has {"tensor": name} in their place. Numbers may be
stored in half precision; they are read as single. Files of torch, which are pickles, are read where
other projects' weights or a training under way are in them.
"""

import hashlib
import io
import json
import pickle
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, TypeVar

import numpy as np
import safetensors.torch
import torch
from torch import nn

from drapeline.errors import DamagedFile, InputError, refuse_damage
from drapeline.models.training.module import BEST
from drapeline.rule_log import LOGGER
from drapeline.storage import atomic_file, parse_json

Network = TypeVar("Network", bound=nn.Module)

_ENTRY, _PREFIX, _REFERENCE = "drapeline", "metadata", "tensor"

SMALL = 10_000  # numbers that are not worth storing in half precision
_RARE = {torch.uint16, torch.uint32, torch.uint64}  # with which torch can do next to nothing
_CHECKPOINT, _PLAIN_WEIGHTS = "a checkpoint in safetensors", "a checkpoint of plain weights"


class Checkpoint(NamedTuple):
    """A trained network as it is stored."""

    weights: dict[str, torch.Tensor]  # by name
    # What the network's `checkpoint_metadata` returned: nested mappings and lists of plain values
    # and tensors, `checkpoint_type` among them.
    metadata: dict[str, Any]


def write_checkpoint(
    path: str | Path, weights: Mapping[str, torch.Tensor], metadata: Mapping[str, Any]
) -> None:
    """Write a network; the same network gives the same bytes.

    Args:
        weights: by name.
        metadata: see `Checkpoint`.

    Raises:
        InputError: the folder is not writable or the disk is full.
    """
    tensors = dict(weights)
    text = json.dumps(_take_tensors(metadata, _PREFIX, tensors), allow_nan=False)
    # Copies, as safetensors refuses weights that share memory.
    copies = {
        name: value.detach().cpu().clone(memory_format=torch.contiguous_format)
        for name, value in tensors.items()
    }
    data = safetensors.torch.save(copies, {_ENTRY: text})
    with atomic_file(path) as scratch:
        scratch.write_bytes(data)


def _whole(tensor: torch.Tensor) -> torch.Tensor:
    """A copy of a tensor, in 32 bits if it was stored in 16."""
    wide = {torch.float16: torch.float32, torch.int16: torch.int32}
    return tensor.to(wide[tensor.dtype]) if tensor.dtype in wide else tensor.clone()


def halve(value: Any) -> Any:
    """Nested mappings and lists with all large tensors in half precision, to be stored.

    Whole numbers of 32 bits are in 16 where these are enough. Small tensors, such as deviations,
    stay as they are.

    Raises:
        InputError: a number is too large for half precision.
    """
    if isinstance(value, torch.Tensor):
        if value.numel() < SMALL:
            return value
        if not value.is_floating_point():
            low, high = -(2**15), 2**15
            fits = value.dtype == torch.int32 and bool(((value >= low) & (value < high)).all())
            return value.short() if fits else value
        half = value.half()
        if not torch.isfinite(half).all():
            raise InputError(
                f"a weight is {float(value.abs().max()):g}, expected at most"
                f" {torch.finfo(torch.float16).max:g} in half precision"
            )
        return half
    if isinstance(value, Mapping):
        return {key: halve(part) for key, part in value.items()}
    return [halve(part) for part in value] if isinstance(value, list | tuple) else value


def _take_tensors(value: Any, name: str, tensors: dict[str, torch.Tensor]) -> Any:
    """The value with references to its tensors, which are added to `tensors`."""
    if isinstance(value, torch.Tensor):
        if name in tensors:
            raise ValueError(f"two tensors are named '{name}'")
        tensors[name] = value
        return {_REFERENCE: name}
    if isinstance(value, Mapping):
        return {key: _take_tensors(part, f"{name}/{key}", tensors) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_take_tensors(part, f"{name}/{k}", tensors) for k, part in enumerate(value)]
    return value


def _put_tensors(value: Any, tensors: dict[str, torch.Tensor]) -> Any:
    """The inverse of `_take_tensors`, which takes what is referred to out of `tensors`."""
    if isinstance(value, dict):
        name = value.get(_REFERENCE)
        if len(value) == 1 and isinstance(name, str):
            if name not in tensors:
                raise ValueError(f"lacks the tensor '{name}'")
            return tensors.pop(name)
        return {key: _put_tensors(part, tensors) for key, part in value.items()}
    return [_put_tensors(part, tensors) for part in value] if isinstance(value, list) else value


def read_checkpoint(path: str | Path) -> Checkpoint:
    """A network that `write_checkpoint` wrote.

    Raises:
        InputError: the file is missing, is no checkpoint, lacks a tensor, holds numbers that are
            not finite, or names sizes that no network with so few weights has.
    """
    path = Path(path)
    if not path.is_file():
        raise DamagedFile(path, "no such file, expected a checkpoint")
    with refuse_damage(path, _CHECKPOINT):
        with safetensors.safe_open(path, "pt") as file:
            text = (file.metadata() or {}).get(_ENTRY)
            # Copies, since the file may be replaced while its pages are mapped.
            tensors = {name: _whole(file.get_tensor(name)) for name in sorted(file.keys())}
        metadata = None if text is None else _put_tensors(parse_json(text), tensors)
        _check_numbers(path, [tensors, metadata], path.stat().st_size)
    if not isinstance(metadata, dict) or not isinstance(metadata.get("checkpoint_type"), str):
        raise DamagedFile(path, "not a checkpoint of drapeline, which has a 'drapeline' entry")
    _refuse_large_sizes(path, metadata, sum(x.numel() for x in tensors.values()))
    return Checkpoint(tensors, metadata)


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


def load_state(module: nn.Module, checkpoint: Checkpoint, path: str | Path) -> None:
    """Load the weights of a checkpoint into a network.

    Raises:
        InputError: a weight is missing, unknown, of another shape, or of another kind of number.
    """
    for name, own in module.state_dict().items():
        given = checkpoint.weights.get(name, own)
        if given.is_floating_point() != own.is_floating_point():
            raise DamagedFile(path, f"'{name}' is of {given.dtype}, expected {own.dtype}")
    try:
        module.load_state_dict(checkpoint.weights)
    except RuntimeError as error:
        reason = str(error).splitlines()[-1].strip()
        raise DamagedFile(path, f"its weights do not fit its network ({reason})") from error


def begin_with(module: nn.Module, start: Mapping[str, str], *, own: Collection[str] = ()) -> None:
    """Let a training begin with the weights of a model that comes with drapeline, and say so.

    Args:
        start: see `drapeline.models.start.start_of`.
        own: names of weights that belong to what is learned from; these and all buffers stay as
            they are.

    Raises:
        InputError: the model is damaged, or its weights do not fit.
    """
    if start["reason"]:
        LOGGER.warning("begins with random weights: %s", start["reason"])
    if not start["folder"]:
        return
    path = Path(start["folder"]) / BEST
    weights = read_checkpoint(path).weights
    kept_names = {*own, *(name for name, _ in module.named_buffers())}
    kept = {name: value for name, value in module.state_dict().items() if name in kept_names}
    try:
        load_state(module, Checkpoint(weights | kept, {}), path)
    except InputError as error:
        raise InputError(
            f"init is package, but the network of {start['folder']} is of another size than the"
            " config's, expected random, or a network of that size"
        ) from error
    LOGGER.info("begins with the weights of %s", start["folder"])


def load_network(
    path: str | Path, kind: str, build: Callable[[Mapping[str, Any]], Network]
) -> Network:
    """A trained network, ready to predict.

    Args:
        kind: its `checkpoint_type`.
        build: makes the network from what its `checkpoint_metadata` gave.

    Raises:
        InputError: the checkpoint is missing, damaged, or of another kind of network.
    """
    checkpoint = read_checkpoint(path)
    found = checkpoint.metadata["checkpoint_type"]
    if found != kind:
        raise DamagedFile(path, f"holds a '{found}' network, expected {kind}")
    with building(path):
        network = build(checkpoint.metadata)
    load_state(network, checkpoint, path)
    return network.eval().requires_grad_(False)


def _refuse_large_sizes(path: str | Path, metadata: Any, weights: int, name: str = "") -> None:
    """Refuse sizes of layers that no network with so few weights has, before it is built."""
    if isinstance(metadata, Mapping):
        for key, value in metadata.items():
            if key not in ("training", "seed"):
                _refuse_large_sizes(path, value, weights, str(key))
    elif isinstance(metadata, list):
        for value in metadata:
            _refuse_large_sizes(path, value, weights, name)
    elif isinstance(metadata, int | float) and not abs(metadata) <= max(weights, 10_000):
        raise DamagedFile(path, f"'{name}' is {metadata}, but it holds {weights} weights")


def _check_numbers(path: Path, value: Any, most: int, name: str = "") -> None:
    """Refuse numbers that are not finite, and tensors that repeat theirs to more than `most`."""
    if isinstance(value, torch.Tensor):
        if value.layout != torch.strided or value.is_meta or value.is_quantized:
            raise DamagedFile(path, f"'{name}' is sparse or without numbers, expected all of them")
        if value.dtype in _RARE:
            raise DamagedFile(path, f"'{name}' is of {value.dtype}, expected plain numbers")
        if value.numel() > most:
            raise DamagedFile(
                path, f"'{name}' is of {value.numel()} numbers, but the file is small"
            )
        if not torch.isfinite(value).all():
            raise DamagedFile(path, f"'{name}' holds NaN or infinity, expected finite numbers")
    elif isinstance(value, Mapping):
        for key, inner in value.items():
            _check_numbers(path, inner, most, str(key))
    elif isinstance(value, list | tuple):
        for inner in value:
            _check_numbers(path, inner, most, name)


# ---- files of torch --------------------------------------------------------------------------


def read_torch_file(path: str | Path) -> Any:
    """Plain values and tensors that torch wrote: others' weights, or a training under way.

    Raises:
        InputError: the file is missing, holds anything else, or weights that are not finite.
    """
    path = Path(path)
    if not path.is_file():
        raise DamagedFile(path, "no such file, expected a checkpoint")
    with refuse_damage(path, _PLAIN_WEIGHTS):
        try:
            found = torch.load(path, map_location="cpu", weights_only=True)
        except pickle.UnpicklingError as error:
            _refuse_objects(path, error)
        # What else a training keeps, such as the best loss before its first epoch, may be infinite.
        weights = found.get("state_dict", found) if isinstance(found, dict) else found
        _check_numbers(path, weights, path.stat().st_size)
    return found


def write_torch_file(path: str | Path, values: Any) -> None:
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
    asks = f"asks Python to run or build '{named[1]}', " if named else ""
    raise DamagedFile(
        path, f"{asks}not readable as {_PLAIN_WEIGHTS}; the file was not opened further"
    ) from None


_DIGESTED_BYTES = 64 << 20  # of an array; a tenth of a second


def arrays_digest(arrays: Mapping[str, np.ndarray]) -> str:
    """Digest of names, shapes and contents of arrays, twelve hexadecimal digits.

    Of an array larger than 64 MiB only every so many rows count: whatever makes data differ, such
    as another seed or an additional sample, changes rows everywhere.
    """
    digest = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        digest.update(f"{name} {array.shape} {array.dtype}".encode())
        every = -(-array.nbytes // _DIGESTED_BYTES) if array.ndim else 1
        part = array[::every] if every > 1 else array
        digest.update(np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()[:12]


def tensors_digest(tensors: Mapping[str, torch.Tensor]) -> str:
    """`arrays_digest` of tensors, such as the weights of a network."""
    return arrays_digest({name: tensor.cpu().numpy() for name, tensor in tensors.items()})
