"""Compare two results folders array by array, to the bit.

    python tests/compare_results.py BEFORE AFTER [--renamed OLD=NEW ...] [--skip PATTERN ...]

Prints the arrays that differ or stand on one side alone, then a count; exits with 1 if there are
any. Arrays are those of .npz, .npy, .mat, .f32, .pc2 and .pc16 files, tensors of .safetensors and
.ckpt files, and pixels of pictures. A refactoring changes none of them. `--renamed` replaces text
in the names of BEFORE (paths, keys of arrays), for files that have moved; `--skip` leaves out names
that match a glob pattern.
"""

import argparse
import hashlib
import sys
from collections.abc import Iterator, Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.torch
import scipy.io
import torch
from PIL import Image, ImageSequence

RAW = {".f32", ".pc2", ".pc16"}
NOT_RESULTS = {"logs", "benchmarks", ".snakemake"}


def array_hashes(folder: str | Path) -> dict[str, str]:
    """Hash of every array of a results folder: "path:key" -> sixteen hexadecimal digits."""
    folder = Path(folder)
    return {
        f"{path.relative_to(folder)}:{key}": _hash(array)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not NOT_RESULTS & set(path.relative_to(folder).parts)
        for key, array in _arrays(path)
    }


def _arrays(path: Path) -> Iterator[tuple[str, np.ndarray]]:
    suffix = path.suffix
    if suffix == ".npz":
        with np.load(path, allow_pickle=False) as archive:
            yield from archive.items()
    elif suffix == ".npy":
        yield "", np.load(path, mmap_mode="r", allow_pickle=False)
    elif suffix in RAW:
        yield "", np.fromfile(path, dtype=np.uint8)
    elif suffix == ".mat":
        values = scipy.io.loadmat(path, simplify_cells=True)
        yield from _leaves({key: value for key, value in values.items() if key[0] != "_"})
    elif suffix == ".safetensors":
        for name, tensor in safetensors.torch.load_file(path).items():
            yield f"/{name}", tensor.numpy()
    elif suffix == ".ckpt":
        checkpoint = torch.load(path, map_location="cpu", weights_only=True)
        # The trainer's callbacks name the folder that a training ran in.
        yield from _leaves({key: part for key, part in checkpoint.items() if key != "callbacks"})
    elif suffix == ".png":
        with Image.open(path) as picture:
            for number, frame in enumerate(ImageSequence.Iterator(picture)):
                yield str(number), np.asarray(frame.convert("RGBA"))


def _leaves(value: Any, name: str = "") -> Iterator[tuple[str, np.ndarray]]:
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _leaves(part, f"{name}/{key}")
    elif isinstance(value, torch.Tensor):
        yield name, value.numpy()
    elif isinstance(value, np.ndarray):
        yield name, value


def _hash(array: np.ndarray) -> str:
    digest = hashlib.sha256(f"{array.dtype.str} {array.shape}".encode())
    digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]


def differences(before: dict[str, str], after: dict[str, str]) -> list[str]:
    """A line for each name whose hash is not the same on both sides."""
    return [
        f"{_verdict(before, after, name)}: {name}"
        for name in sorted(before.keys() | after.keys())
        if before.get(name) != after.get(name)
    ]


def _verdict(before: dict[str, str], after: dict[str, str], name: str) -> str:
    if name not in after:
        return "only before"
    return "differs" if name in before else "only after"


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--renamed", nargs="*", default=[], metavar="OLD=NEW")
    parser.add_argument("--skip", nargs="*", default=[], metavar="PATTERN")
    given = parser.parse_args(arguments)
    before = array_hashes(given.before)
    for pair in given.renamed:
        old, new = pair.split("=")
        before = {name.replace(old, new): value for name, value in before.items()}
    kept = [
        {k: v for k, v in side.items() if not any(fnmatch(k, pattern) for pattern in given.skip)}
        for side in (before, array_hashes(given.after))
    ]
    found = differences(*kept)
    same = len(kept[0].keys() & kept[1].keys()) - sum(line.startswith("differs") for line in found)
    sys.stdout.write("".join(f"{line}\n" for line in found))
    sys.stdout.write(f"{same} arrays are the same to the bit, {len(found)} are not\n")
    return 1 if found or not same else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
