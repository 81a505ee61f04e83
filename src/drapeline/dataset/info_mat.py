"""`info.mat`: what CLOTH3D stores about a sample besides its meshes."""

import io
import math
import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from drapeline.dataset.matlab import read_matlab
from drapeline.errors import DamagedFile
from drapeline.frames import GENDERS
from drapeline.storage import atomic_file, check_name

# The 116 free bytes at the start of a MATLAB v5 file. scipy writes the current time there, so that
# files with equal contents would differ.
_HEADER_TEXT = b"MATLAB 5.0 MAT-file Platform: posix".ljust(116)


@dataclass(frozen=True)
class SampleInfo:
    """Contents of an `info.mat`.

    Attributes:
        poses: (N, 72) float64 axis-angle in radians; the root rotation includes the turn from Y up
            to Z up.
        trans: (N, 3) float64 world position of the root joint in metres.
        shape: (10,) float64 shape coefficients.
        gender: "female" or "male".
        zrot: rotation of the whole scene about +Z in radians.
        outfit: garment name -> {"texture": {"type", "data"}, "fabric"}; the fabric may be missing
            (test sets of the original), and only textures of type "color" have `data`.
        tightness: (2,) float64, or None if the file has none.
        camera_location: (3,) float64 in metres, or None.
        lights: {"type": "point", "data": [{"loc": (3,), "pwr": watts}, ...]} or
            {"type": "sun", "data": {"pwr": W/m2, "rot": (3,) Euler radians}}, or None.
    """

    poses: np.ndarray
    trans: np.ndarray
    shape: np.ndarray
    gender: str
    zrot: float = 0.0
    outfit: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    tightness: np.ndarray | None = None
    camera_location: np.ndarray | None = None
    lights: Mapping[str, Any] | None = None


class Placement(NamedTuple):
    """The part of an `info.mat` that vertices need."""

    # Names of the outfit's garments in the stored order; () if it is not stored.
    garments: tuple[str, ...]
    trans: np.ndarray  # (N, 3) float64 world position of the root joint in metres
    zrot: float  # rotation of the whole scene about +Z in radians


def sample_scene(rng: np.random.Generator) -> tuple[np.ndarray, dict[str, Any]]:
    """Draw a camera location (3,) and lights from the ranges observed in CLOTH3D's samples.

    The camera stands on the +X axis and looks along -X. Half of the scenes are lit by the sun, the
    other half by one to three point lights above the subject.
    """
    camera = np.array([rng.uniform(4.4, 5.8), 0.0, 1.0])
    if rng.random() < 0.5:
        tilt, turn = rng.uniform(0.0, np.pi / 4), rng.uniform(0.0, 2 * np.pi)
        sun = {"pwr": rng.uniform(3.5, 4.5), "rot": np.array([tilt, 0.0, turn])}
        return camera, {"type": "sun", "data": sun}
    lights = []
    for _ in range(rng.integers(1, 4)):
        turn, distance = rng.uniform(0.0, 2 * np.pi), rng.uniform(2.0, 4.0)
        place = [distance * np.cos(turn), distance * np.sin(turn), rng.uniform(2.0, 4.0)]
        lights.append({"loc": np.array(place), "pwr": rng.uniform(54.0, 87.0)})
    return camera, {"type": "point", "data": lights}


def write_info(path: str | Path, info: SampleInfo) -> None:
    """Write an `info.mat` with CLOTH3D's fields in CLOTH3D's order, types and shapes.

    Equal contents give equal bytes.
    """
    import scipy.io  # here, because far more jobs read the file than write it

    fields: dict[str, Any] = {"shape": np.asarray(info.shape, np.float64).reshape(1, 10)}
    if info.lights is not None:
        data = info.lights["data"]
        # A single point light is a bare struct, several are a cell of structs.
        single = isinstance(data, list) and len(data) == 1
        fields["lights"] = {"type": info.lights["type"], "data": data[0] if single else data}
    if info.camera_location is not None:
        fields["camLoc"] = np.asarray(info.camera_location, np.float64).reshape(1, 3)
    fields["zrot"] = float(info.zrot)
    if info.tightness is not None:
        fields["tightness"] = np.asarray(info.tightness, np.float64).reshape(1, 2)
    fields["outfit"] = {name: _garment_struct(value) for name, value in info.outfit.items()}
    fields["gender"] = GENDERS.index(info.gender)
    fields["trans"] = np.asarray(info.trans, np.float64).reshape(-1, 3).T
    fields["poses"] = np.asarray(info.poses, np.float64).reshape(-1, 72).T
    stream = io.BytesIO()
    scipy.io.savemat(stream, fields)
    with atomic_file(path) as scratch:
        scratch.write_bytes(_HEADER_TEXT + stream.getvalue()[len(_HEADER_TEXT) :])


def _garment_struct(garment: Mapping[str, Any]) -> dict[str, Any]:
    texture = {"type": garment["texture"]["type"]}
    if "data" in garment["texture"]:
        texture["data"] = np.asarray(garment["texture"]["data"], np.float64).reshape(1, 3)
    struct: dict[str, Any] = {"texture": texture}
    if "fabric" in garment:
        struct["fabric"] = garment["fabric"]
    return struct


def read_info(path: str | Path) -> SampleInfo:
    """Read an `info.mat`, ours or an original one.

    Raises:
        InputError: the file is missing, is not MATLAB v5, lacks a field that every sample has, or
            holds arrays of inconsistent shapes.
    """
    values = _read(path, ("poses", "trans", "shape", "gender"))
    # Squeezing turns the single column of a one-frame sample into a plain vector.
    poses = _columns(path, "poses", values["poses"], 72)
    trans = _columns(path, "trans", values["trans"], 3)
    if len(poses) != len(trans):
        raise DamagedFile(
            path, f"{len(poses)} poses but {len(trans)} trans, expected equal numbers"
        )
    gender = values["gender"]
    if not isinstance(gender, int | float) or gender not in (0, 1):
        raise DamagedFile(path, f"gender is {gender!r:.100}, expected 0 (female) or 1 (male)")
    tightness, camera = values.get("tightness"), values.get("camLoc")
    return SampleInfo(
        poses=poses,
        trans=trans,
        shape=_columns(path, "shape", values["shape"], 10)[0],
        gender=GENDERS[int(gender)],
        zrot=_zrot(path, values),
        outfit=_outfit(path, values.get("outfit")),
        tightness=None if tightness is None else _columns(path, "tightness", tightness, 2)[0],
        camera_location=None if camera is None else _columns(path, "camLoc", camera, 3)[0],
        lights=_lights(path, values.get("lights")),
    )


def read_placement(path: str | Path) -> Placement:
    """Read only as much of an `info.mat` as vertices need.

    Raises:
        InputError: as `read_info`, but damage in other fields may not be noticed.
    """
    names = ("outfit", "trans", "zrot")
    values = _read(path, ("trans",), names=names, outlines=("outfit",))
    outfit = values.get("outfit")
    garments = tuple(outfit) if isinstance(outfit, dict) else ()
    for name in garments:
        check_name(name, f"{path}: a garment")
    return Placement(garments, _columns(path, "trans", values["trans"], 3), _zrot(path, values))


def _read(path: str | Path, required: Collection[str], **selection: Any) -> dict[str, Any]:
    """Variables of a file, which there must be; see `read_matlab` for the selection."""
    if not os.path.isfile(path):
        raise DamagedFile(path, "no such file, expected the info.mat of a CLOTH3D sample")
    values = read_matlab(path, **selection)
    missing = [name for name in required if name not in values]
    if missing:
        raise DamagedFile(path, f"lacks {', '.join(missing)}; it holds {', '.join(values)}")
    return values


def _zrot(path: str | Path, values: Mapping[str, Any]) -> float:
    zrot = values.get("zrot", 0.0)
    if not isinstance(zrot, int | float) or not math.isfinite(zrot):
        raise DamagedFile(path, f"zrot is {zrot!r:.100}, expected an angle in radians")
    return float(zrot)


def _outfit(path: str | Path, outfit: Any) -> dict[str, dict[str, Any]]:
    if not isinstance(outfit, dict):
        return {}
    for name, garment in outfit.items():
        check_name(name, f"{path}: a garment")
        told = garment if isinstance(garment, dict) else {}
        texture, fabric = told.get("texture"), told.get("fabric", "")
        texture = texture if isinstance(texture, dict) else {}
        if not isinstance(texture.get("type"), str) or not isinstance(fabric, str):
            raise DamagedFile(
                path, f"{name} is {garment!r:.100}, expected a texture with a type, and a fabric"
            )
        if "data" in texture:
            _columns(path, f"the colour of {name}", texture["data"], 3)
    return outfit


def _lights(path: str | Path, lights: Any) -> dict[str, Any] | None:
    if lights is None:
        return None
    if not isinstance(lights, dict) or not {"type", "data"} <= lights.keys():
        raise DamagedFile(path, f"lights are {lights!r:.100}, expected a type and data")
    # A single point light is a bare struct.
    single = lights["type"] == "point" and isinstance(lights["data"], dict)
    return {**lights, "data": [lights["data"]]} if single else lights


def _columns(path: str | Path, name: str, value: Any, rows: int) -> np.ndarray:
    """Transpose an array (rows, N), or (rows,) if it was squeezed, to (N, rows) float64."""
    array = value if isinstance(value, np.ndarray) else np.zeros(0)
    if array.shape[:1] != (rows,) or array.ndim > 2:
        raise DamagedFile(path, f"{name} has shape {array.shape}, expected ({rows}, N)")
    array = np.ascontiguousarray(array.reshape(rows, -1).T, dtype=np.float64)
    if not np.isfinite(array).all():
        raise DamagedFile(path, f"{name} holds NaN or infinity, expected finite numbers")
    return array
