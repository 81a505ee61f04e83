"""Garments fitted to segmented scans: classes that they are compared by, and files for figures."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.storage import load_npz, save_npz

# As in table 2 of SMPLicit, which has no garments for the whole body.
CLASSES = ("short upper", "long upper", "short lower", "long lower", "whole body")
COMMON = "common types"  # garments of the types that every model can learn, of whatever class
TRUE, BODY = "true", "body"  # what figures show besides fits
_LONG = 0.5  # share of the limb

# Variant -> garment type, or `BODY` -> posed triangles. The variant `BODY` has the body that is
# shown where a variant has none of its own.
Fits = Mapping[str, Mapping[str, Mesh]]


def scan_class(region: str, properties: Mapping[str, float]) -> str:
    """The class of a garment.

    Args:
        region: of its type, as in `GARMENT_TYPES`.
        properties: of it, see `drapeline.metrics.properties`.
    """
    if region == "whole":
        return CLASSES[-1]
    reach = properties["sleeve" if region == "upper" else "leg"]
    return f"{'long' if reach >= _LONG else 'short'} {region}"


_ARRAYS = {"keys": "str n", "*/vertices": "float * 3", "*/faces": "int * 3"}


def save_fitted_scans(path: str | Path, found: Mapping[str, Fits]) -> None:
    """Write scan's name -> fits, which `load_fitted_scans` reads."""
    arrays, keys = {}, []
    for scan, variants in found.items():
        for variant, garments in variants.items():
            for name, mesh in garments.items():
                key = f"{scan}/{variant}/{name}"
                keys.append(key)
                arrays[f"{key}/vertices"] = mesh.vertices.astype(np.float32)
                arrays[f"{key}/faces"] = mesh.faces.astype(np.int32)
    save_npz(path, keys=np.array(keys, dtype=np.str_), **arrays)


def load_fitted_scans(path: str | Path) -> dict[str, dict[str, dict[str, Mesh]]]:
    """Read what `save_fitted_scans` wrote.

    Raises:
        InputError: the file is missing, lacks an array or names none of a fit.
    """
    arrays = load_npz(path, _ARRAYS)
    found: dict[str, dict[str, dict[str, Mesh]]] = {}
    for key in map(str, arrays["keys"]):
        if key.count("/") != 2:
            raise InputError(f"{path}: names a fit '{key:.80}', expected scan/variant/garment")
        scan, variant, name = key.split("/")
        mesh = Mesh(arrays[f"{key}/vertices"], arrays[f"{key}/faces"])
        found.setdefault(scan, {}).setdefault(variant, {})[name] = mesh
    return found
