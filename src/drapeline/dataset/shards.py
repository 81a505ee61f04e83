"""Samples of the learning group: folders of CLOTH3D folders, one for each job that made them."""

from collections.abc import Iterable
from pathlib import Path

from drapeline.errors import InputError


def samples_of_shards(shards: Iterable[str | Path]) -> list[Path]:
    """Folders of every sample in some shards, or of what was made of them, in order of their ids.

    Args:
        shards: folders that hold nothing but a folder for each sample, named by its id.

    Raises:
        InputError: a shard is missing.
    """
    found = []
    for shard in map(Path, shards):
        if not shard.is_dir():
            raise InputError(f"{shard}: no such folder, expected one with samples")
        found += sorted(path for path in shard.glob("[!.]*") if path.is_dir())
    return found
