"""Static outfits: outfits in rest pose, many to a file, made for learning."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drapeline.outfits.outfit import OUTFIT_JSON, Garment, Outfit
from drapeline.storage import load_npz, read_json, save_npz, write_json


class StaticOutfit(NamedTuple):
    """An outfit of a shard.

    Attributes:
        name: of its plan.
        split: "train", "val" or "test".
        outfit: garments with vertices and faces; textures and pins are left out.
    """

    name: str
    split: str
    outfit: Outfit


def save_static(path: str | Path, outfits: Iterable[StaticOutfit]) -> None:
    """Write arrays to `path` under `{name}/{garment}/...`, the rest to a `.json` beside it."""
    outfits = list(outfits)
    save_npz(
        path,
        **{
            f"{name}/{g.name}/{key}": getattr(g, key)
            for name, _, outfit in outfits
            for g in outfit.garments
            for key in ("vertices", "faces")
        },
    )
    write_json(
        Path(path).with_suffix(".json"),
        [
            {
                "name": name,
                "split": split,
                "gender": outfit.gender,
                "shape": outfit.shape.tolist(),
                "tightness": outfit.tightness.tolist(),
                "signed_tightness": outfit.signed_tightness.tolist(),
                "garments": [{"name": g.name, **g.about} for g in outfit.garments],
            }
            for name, split, outfit in outfits
        ],
    )


def load_static(path: str | Path) -> list[StaticOutfit]:
    """Read what `save_static` wrote.

    Raises:
        InputError: a file is missing or lacks a garment's arrays.
    """
    form = {"name": str, "split": str, **OUTFIT_JSON, "garments": [{"name": str}]}
    told = read_json(Path(path).with_suffix(".json"), [form])
    names = [f"{about['name']}/{g['name']}" for about in told for g in about["garments"]]
    arrays = load_npz(
        path,
        {f"{name}/vertices": f"float v{index} 3" for index, name in enumerate(names)}
        | {f"{name}/faces": f"int<v{index} * *" for index, name in enumerate(names)},
    )
    return [_read(about, arrays) for about in told]


def _read(about: dict, arrays: Mapping[str, np.ndarray]) -> StaticOutfit:
    garments = tuple(
        Garment(
            g["name"],
            arrays[f"{about['name']}/{g['name']}/vertices"],
            arrays[f"{about['name']}/{g['name']}/faces"],
            uv=np.zeros((0, 2), np.float32),
            uv_faces=np.zeros((0, 4), np.int32),
            pin=np.zeros(0, np.float32),
            elastic=np.zeros(0, np.float32),
            about={k: v for k, v in g.items() if k != "name"},
        )
        for g in about["garments"]
    )
    outfit = Outfit(
        garments,
        np.array(about["shape"]),
        np.array(about["tightness"]),
        np.array(about["signed_tightness"]),
        about["gender"],
    )
    return StaticOutfit(about["name"], about["split"], outfit)
