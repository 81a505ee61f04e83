"""Shards of outfits at rest."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from drapeline.outfits.outfit import Garment
from drapeline.outfits.static import StaticOutfit


def save_static(shard: Path, outfits: Iterable[StaticOutfit]) -> Path:
    """Write outfits as the rule `make_outfits` does, with what toys lack; returns the shard."""
    for name, split, outfit in outfits:
        whole = replace(outfit, garments=tuple(map(_whole, outfit.garments)))
        whole.save(shard / f"{name}.npz", shard / f"{name}.json", split=split)
    return shard


def _whole(garment: Garment) -> Garment:
    """With a texture, ends and a fabric, if it has none."""
    attributes = {"fabric": "cotton", "texture": {"type": "color"}, **garment.attributes}
    if len(garment.pin):
        return replace(garment, attributes=attributes)
    ends = np.zeros(len(garment.vertices), np.float32)
    return replace(
        garment,
        uv=np.zeros((1, 2), np.float32),
        uv_faces=np.zeros_like(garment.faces),
        pin=ends,
        elastic=ends,
        band=ends,
        attributes=attributes,
    )
