"""Digests of what a training depends on, so that it is taken up again with the same alone."""

import hashlib
from collections.abc import Mapping

import numpy as np
import torch

_DIGESTED_BYTES = 64 << 20  # of an array; a tenth of a second


def arrays_digest(arrays: Mapping[str, np.ndarray]) -> str:
    """Of names, shapes and contents, for the `settings` that a training is taken up again with.

    Of an array larger than 64 MiB every so many rows count alone: what makes other data, such as a
    seed or one more sample, changes rows everywhere.
    """
    digest = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        digest.update(f"{name} {array.shape} {array.dtype}".encode())
        every = -(-array.nbytes // _DIGESTED_BYTES) if array.ndim else 1
        part = array[::every] if every > 1 else array
        digest.update(np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()[:12]


def tensors_digest(tensors: Mapping[str, torch.Tensor]) -> str:
    """The same of tensors, such as the weights of a network."""
    return arrays_digest({name: tensor.cpu().numpy() for name, tensor in tensors.items()})
