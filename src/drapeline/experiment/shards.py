"""Samples in shards: some of an experiment's samples, made by one job in a folder of their own."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from drapeline.errors import InputError


def shard_samples(samples: Iterable[str], size: int | None) -> dict[str, list[str]]:
    """Shard -> ids of its samples, in their order; the last may have fewer than `size`.

    Without a size there are no shards.
    """
    if size is None:
        return {}
    ids = list(samples)
    digits = max(len(str((len(ids) - 1) // size)), 3)
    return {
        f"{start // size:0{digits}d}": ids[start : start + size]
        for start in range(0, len(ids), size)
    }


def shard_settings(settings: Mapping[str, Any], folder: str) -> dict[str, Any]:
    """Settings by which the samples of a shard are made one by one, with results in its folder."""
    samples = {**settings["samples"], "shard_size": None}
    return {**settings, "results": folder, "samples": samples}


def files_in_shard(outputs: Iterable[str], results: str, folder: str) -> dict[Path, Path]:
    """What a shard delivers: where its folder has it -> where the experiment has it.

    Args:
        outputs: files and folders below the experiment's results.
        results: the experiment's folder of results.
        folder: the shard's.
    """
    return {Path(folder) / Path(file).relative_to(results): Path(file) for file in outputs}


def deliver(files: Mapping[Path, Path]) -> None:
    """Move what a shard has made to where the experiment has it, if it has made all.

    Raises:
        InputError: something is missing; nothing is moved then, so that a next try finds the rest.
    """
    missing = [path for path in files if not path.exists()]
    if missing:
        raise InputError(
            f"{missing[0]} and {len(missing) - 1} more of {len(files)} files could not be made;"
            " the next try goes on with these"
        )
    for path, target in files.items():
        target.parent.mkdir(parents=True, exist_ok=True)
        path.replace(target)
