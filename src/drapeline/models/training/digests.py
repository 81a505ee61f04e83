"""Digests of what a training depends on, so that it is resumed only if that is unchanged."""

import hashlib
from collections.abc import Mapping

import numpy as np
import torch

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
