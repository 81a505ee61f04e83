"""Records of written samples (`meta.json` and file sizes), and fingerprints of bodies."""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.errors import DamagedFile
from drapeline.manifest import MANIFEST
from drapeline.storage import check_name, read_json

SPLITS = ("train", "val", "test")
# What is read of a sample's `meta.json`, and of the `status.json` of its registration.
META = {
    **dict.fromkeys(("id?", "status?", "split?", "reason?"), str),
    "conventions?": {"rest_obj_is_turned_by_zrot?": bool},
    "body?": {"gender?": str, "fingerprint?": str, "vertices?": int},
    "motion?": {"frames?": int, **dict.fromkeys(("sequence?", "action?", "source?"), str)},
    "outfit?": {"garments?": [{"name": str, "fabric?": str, "texture?": {"data?": 3 * [float]}}]},
    "garments?": dict,
    "health?": dict,
    "simulation?": {"solver?": {"name?": str}, "attempts?": [dict]},
    "self_collision?": dict,
}
STATUS = {"id": str, "status": str, "split": str}
# Measures of every frame, and perhaps of every garment; those that make no sense there are NaN.
HEALTH = {"*": "any|nan frames ..."}
# What of a body took part in collisions, and where its parts were pressed apart; how much of an
# elastic each vertex of a garment has, and how firmly it was held.
BODY_MASKS = {
    "collides": "bool vertices",
    "fix_frame": "int<frames moves",
    "fix_vertex": "int<vertices moves",
    "fix_delta": "float moves 3",
}
GARMENT_MASKS = {name: "float vertices" for name in ("elastic", "held", "band?")}
# Subfolder of a sample with everything that CLOTH3D does not have. Some of its readers take every
# OBJ or PC16 file beside `info.mat` for a garment, so only its own files may lie there.
EXTRAS = "extras"
SAMPLE_MANIFEST = f"{EXTRAS}/{MANIFEST}"


@dataclass(frozen=True)
class SampleRecord:
    """A sample's folder, its `meta.json` and the size of its files."""

    folder: Path
    meta: Mapping[str, Any]  # contents of its `meta.json`
    cloth3d_bytes: int  # total size of the files in CLOTH3D's layout
    total_bytes: int

    @property
    def accepted(self) -> bool:
        """Whether the sample is part of the dataset."""
        return self.meta["status"] == "accepted"


def read_record(folder: str | Path) -> SampleRecord:
    """Read a sample's `meta.json` and measure its files.

    Raises:
        InputError: there is no `meta.json`, or it lacks a key that every sample has.
    """
    folder = Path(folder)
    meta = read_meta(folder)
    missing = [key for key in ("id", "status", "split", "motion", "outfit") if key not in meta]
    if missing:
        raise DamagedFile(meta_path(folder), f"lacks {', '.join(missing)}")
    check_name(meta["id"], f"{meta_path(folder)}: 'id'")
    if meta["split"] not in SPLITS:
        raise DamagedFile(
            meta_path(folder), f"'split' is '{meta['split']}', expected {', '.join(SPLITS)}"
        )
    sizes = {path: path.stat().st_size for path in folder.rglob("*") if path.is_file()}
    cloth3d_bytes = sum(size for path, size in sizes.items() if path.parent == folder)
    return SampleRecord(folder, meta, cloth3d_bytes, sum(sizes.values()))


def meta_path(folder: str | Path) -> Path:
    """Path of the `meta.json` of the sample in `folder`."""
    return Path(folder) / EXTRAS / "meta.json"


def read_meta(folder: str | Path) -> dict[str, Any]:
    """Read the `meta.json` of the sample in `folder`.

    Raises:
        InputError: the file is missing or not JSON.
    """
    return read_json(meta_path(folder), META)


def solver_name(meta: Mapping[str, Any]) -> str:
    """The cloth solver that made a sample; empty if its record does not say."""
    return meta.get("simulation", {}).get("solver", {}).get("name", "")


def clip_name(meta: Mapping[str, Any], sample: str) -> str:
    """The clip that a sample's motion is a piece of; its own name if its record does not say."""
    piece = meta.get("motion", {}).get("sequence", "")
    return re.sub(r"_s\d+$", "", piece) or sample


def outfit_text(meta: Mapping[str, Any]) -> str:
    """A sample's garments and their fabrics in words, such as "Top (silk), Skirt (denim)"."""
    worn = meta["outfit"]["garments"]
    return ", ".join(f"{garment['name']} ({garment['fabric']})" for garment in worn)


def body_fingerprint(body: BodyModel) -> str:
    """SHA-256 of the arrays that determine the vertices of a posed body."""
    digest = hashlib.sha256()
    for array in (body.v_template, body.shapedirs, body.posedirs, body.J_regressor, body.weights):
        digest.update(np.ascontiguousarray(array, dtype="<f4").data)
    digest.update(np.ascontiguousarray(body.faces, dtype="<i4").data)
    return digest.hexdigest()
