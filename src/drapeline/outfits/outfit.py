"""Outfits: garments made for one body, and their files."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from drapeline.storage import load_npz, read_json, save_npz, write_json


@dataclass(frozen=True)
class Garment:
    """A garment in rest pose on a body."""

    name: str  # one of `GARMENTS`
    vertices: np.ndarray  # (V, 3) float32 metres, root-relative, Z up
    faces: np.ndarray  # (F, 4) int32
    # uv, uv_faces: (T, 2) float32 in [0, 1] and (F, 4) int32.
    uv: np.ndarray
    uv_faces: np.ndarray
    pin: np.ndarray  # (V,) float32, 1 where the waistband is held
    elastic: np.ndarray  # (V,) float32, 1 on ends that are gathered
    # (V,) float32, how much of a band a vertex is: 1 on collars, cuffs, waistbands, less on hems.
    band: np.ndarray
    # What goes into the JSON file: fabric, elastic, texture, parameters.
    attributes: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Outfit:
    """Garments from inner to outer, and whom they are made for."""

    garments: tuple[Garment, ...]
    shape: np.ndarray  # (10,) the wearer's shape
    tightness: np.ndarray  # (2,) gamma as drawn
    signed_tightness: np.ndarray  # (2,) the same with the gender's sign
    gender: str  # "female" or "male"

    def save(self, npz_path: str | Path, json_path: str | Path, *, split: str = "") -> None:
        """Write arrays under `{name}/...` and everything else as JSON.

        Args:
            split: of an outfit at rest; that of a simulated one is in its sample's record.
        """
        arrays = {}
        for g in self.garments:
            for key in _ARRAYS:
                arrays[f"{g.name}/{key}"] = getattr(g, key)
        save_npz(npz_path, **arrays)
        write_json(
            json_path,
            {
                "garments": [{"name": g.name, **g.attributes} for g in self.garments],
                "gender": self.gender,
                "tightness": self.tightness.tolist(),
                "signed_tightness": self.signed_tightness.tolist(),
                "shape": self.shape.tolist(),
                **({"split": split} if split else {}),
            },
        )


# `data` is the colour of most of it; of a "pattern", `print` is what `prints.draw_print` takes.
_TEXTURE = {"type": str, "data?": 3 * [float], "print?": dict}
OUTFIT_JSON = {
    "garments": [{"name": str, "fabric": str, "texture": _TEXTURE}],
    "gender": str,
    "shape": 10 * [float],
    "tightness": 2 * [float],
    "signed_tightness": 2 * [float],
}
# Sizes differ from garment to garment.
_ARRAYS = {
    "vertices": "float {v} 3",
    "faces": "int<{v} {f} {k}",
    "uv": "float {t} 2",
    "uv_faces": "int<{t} {f} {k}",
    "pin": "float {v}",
    "elastic": "float {v}",
    "band": "float {v}",
}


def load_outfit(npz_path: str | Path, json_path: str | Path) -> Outfit:
    """Read what `Outfit.save` wrote.

    Raises:
        InputError: a file is missing or lacks a garment's arrays.
    """
    about = read_json(json_path, OUTFIT_JSON)
    names = [g["name"] for g in about["garments"]]
    arrays = load_npz(
        npz_path,
        {
            f"{name}/{key}": form.format(**{size: f"{size}{index}" for size in "vtfk"})
            for index, name in enumerate(names)
            for key, form in _ARRAYS.items()
        },
    )
    garments = tuple(
        Garment(
            g["name"],
            **{key: arrays[f"{g['name']}/{key}"] for key in _ARRAYS},
            attributes={k: v for k, v in g.items() if k != "name"},
        )
        for g in about["garments"]
    )
    return Outfit(
        garments,
        np.array(about["shape"]),
        np.array(about["tightness"]),
        np.array(about["signed_tightness"]),
        about["gender"],
    )
