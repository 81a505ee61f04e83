"""Samples of any groups: folders of CLOTH3D folders, one for each job that made them."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from drapeline.errors import InputError


def samples_of(shards: Iterable[str | Path]) -> list[Path]:
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


def samples_named(shards: Iterable[str | Path], names: Sequence[str]) -> list[Path]:
    """Folders of some samples, in the order of their names.

    Args:
        shards: folders that hold nothing but a folder for each sample, named by its id.

    Raises:
        InputError: a shard or a sample is missing.
    """
    folders = {path.name: path for path in samples_of(shards)}
    missing = [name for name in names if name not in folders]
    if missing:
        raise InputError(f"{missing[0]}: no such sample, expected one of {', '.join(folders)}")
    return [folders[name] for name in names]
