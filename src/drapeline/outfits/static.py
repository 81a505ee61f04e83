"""Outfits at rest, in shards: made for learning, and moved by nothing."""

from pathlib import Path
from typing import NamedTuple

from drapeline.errors import InputError
from drapeline.outfits.outfit import Outfit, load_outfit
from drapeline.storage import read_json


class StaticOutfit(NamedTuple):
    """An outfit of a shard."""

    name: str  # of its plan
    split: str  # "train", "val" or "test"
    outfit: Outfit


def load_static(shard: str | Path) -> list[StaticOutfit]:
    """Read the outfits of a shard of a group at rest, in order of their names.

    Args:
        shard: folder with an `.npz` and a `.json` of each, see `Outfit.save`.

    Raises:
        InputError: a file is missing or lacks a garment's arrays.
    """
    names = {file.stem for file in Path(shard).glob("[!.]*") if file.suffix in (".npz", ".json")}
    if not names:
        raise InputError(f"{shard}: holds no outfit, expected an .npz and a .json of each")
    return [
        _read(Path(shard) / f"{name}.npz", Path(shard) / f"{name}.json") for name in sorted(names)
    ]


def _read(arrays: Path, about: Path) -> StaticOutfit:
    split = read_json(about, {"split": str})["split"]
    return StaticOutfit(about.stem, split, load_outfit(arrays, about))
