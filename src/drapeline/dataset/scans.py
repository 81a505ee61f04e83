"""Scans brought by the user: clouds or meshes of a dressed person, frame by frame, and the body.

Frames are a folder of `.ply`, `.obj` or `.npz` files in the order of their names, or one `.npz`
with all of them. The body is an `.npz` of its parameters. Both are checked at the door, since a
network gives an answer to anything: in millimetres, on its side, or one frame late.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import trimesh
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from drapeline.bodies.model import BodyModel, posed_vertices, shaped
from drapeline.errors import InputError
from drapeline.frames import FPS, GENDERS
from drapeline.geometry.mesh import load_obj
from drapeline.seeding import rng_for
from drapeline.storage import load_npz

SUFFIXES = (".ply", ".obj", ".npz")
_HUGE_M, _TINY_M = 4.0, 0.2  # no person with arms and hair spread is larger, or smaller
_FAR_M = 0.15  # points of a dressed person lie so near to the body, in the median
_CHECKED = 500  # points of a frame that are held against the body
# Names under which an `.npz` of one frame may hold its points; CAPE has the second.
_POINT_KEYS = ("points", "v_posed", "vertices")


class Scan(NamedTuple):
    """What was scanned in one frame.

    Attributes:
        points: (n, 3) float32 metres.
        triangles: (F, 3) int32 where the scan is a mesh, else None.
    """

    points: np.ndarray
    triangles: np.ndarray | None


@dataclass(frozen=True)
class BodyParameters:
    """A known body in motion, in our frame: metres, Z up.

    Attributes:
        poses: (F, 72) rad.
        trans: (F, 3) places of the root joint.
        shape: (10,).
        gender: "female" or "male".
    """

    poses: np.ndarray
    trans: np.ndarray
    shape: np.ndarray
    gender: str


@dataclass(frozen=True)
class ScanSequence:
    """Scans with the body that wears what was scanned.

    Attributes:
        scans: of F frames, relative to the root joint, Z up.
        body: its parameters.
    """

    scans: tuple[Scan, ...]
    body: BodyParameters

    def __len__(self) -> int:
        return len(self.scans)

    def points(self, count: int, *, seed: int) -> np.ndarray:
        """(F, P, 3) float32: `count` points of every frame, in no order.

        Meshes are sampled evenly by area. Clouds lose points, or have some of them twice.
        """
        return np.stack(
            [
                _resampled(scan, count, rng_for(seed, "scan", frame))
                for frame, scan in enumerate(self.scans)
            ]
        )


def _resampled(scan: Scan, count: int, rng: np.random.Generator) -> np.ndarray:
    if scan.triangles is None:
        have = len(scan.points)
        order = [rng.permutation(have) for _ in range(-(-count // have))]
        return rng.permutation(scan.points[np.concatenate(order)[:count]])
    a, b, c = (scan.points[scan.triangles[:, i]] for i in range(3))
    upto = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1), dtype=np.float64)
    face = np.searchsorted(upto, upto[-1] * rng.random(count), side="right")
    face = np.minimum(face, len(upto) - 1)
    u, v = rng.random((2, count, 1), dtype=np.float32)
    u = np.sqrt(u)
    return (1 - u) * a[face] + u * ((1 - v) * b[face] + v * c[face])


def read_scans(
    frames: str | Path,
    parameters: str | Path,
    bodies: Mapping[str, BodyModel],
    *,
    up: Literal["z", "y"] = "z",
    fps: int = FPS,
) -> ScanSequence:
    """Read scans and their body at 30 frames per second, and check that they belong together.

    Args:
        frames: folder of `.ply`, `.obj` or `.npz` files, or one `.npz` with `points` (F, P, 3), or
            with `points` (n, 3) of all frames and `counts` (F,) of each; world, metres.
        parameters: `.npz` with `poses` (F, 72) rad, `shape` (10,), `gender` ("female", "male", 0
            or 1) and `trans` (F, 3), world places of the root joint, or `transl` (F, 3), SMPL's
            translation of the body.
        bodies: by gender.
        up: which axis points up in both files. CAPE has "y".
        fps: frames per second of both files, a multiple of 30, of which so many are kept. CAPE
            has 60.

    Raises:
        InputError: names the file, what is wrong with it and what was expected.
    """
    if fps < FPS or fps % FPS:
        raise InputError(f"{frames}: {fps} frames per second, expected a multiple of {FPS}")
    scans = read_frames(frames)
    body = read_body_parameters(parameters, bodies)
    if len(scans) != len(body.poses):
        raise InputError(
            f"{frames}: {len(scans)} frames, but {parameters} has {len(body.poses)} poses;"
            " expected as many"
        )
    every = fps // FPS
    scans = scans[::every]
    body = replace(body, poses=body.poses[::every], trans=body.trans[::every])
    points = [scan.points - at for scan, at in zip(scans, body.trans, strict=True)]
    if up == "y":
        points = [_upright(p) for p in points]
        body = _stood_up(body)
    _check_place(frames, points, body, bodies[body.gender])
    return ScanSequence(
        tuple(Scan(p.astype(np.float32), s.triangles) for p, s in zip(points, scans, strict=True)),
        body,
    )


def _upright(points: np.ndarray) -> np.ndarray:
    """Y up to Z up: a quarter turn about X."""
    return np.stack([points[..., 0], -points[..., 2], points[..., 1]], axis=-1)


def _stood_up(body: BodyParameters) -> BodyParameters:
    turn = Rotation.from_euler("x", 90, degrees=True)
    poses = body.poses.copy()
    poses[:, :3] = (turn * Rotation.from_rotvec(poses[:, :3])).as_rotvec()
    return replace(body, poses=poses, trans=_upright(body.trans))


def _check_place(
    path: str | Path, points: list[np.ndarray], body: BodyParameters, model: BodyModel
) -> None:
    """Refuse clouds that do not lie on the body: another frame of reference, or another time."""
    for frame in sorted({0, len(points) // 2, len(points) - 1}):
        posed, _ = posed_vertices(model, body.shape, body.poses[frame : frame + 1])
        some = points[frame][:: max(len(points[frame]) // _CHECKED, 1)]
        distance = float(np.median(KDTree(posed[0]).query(some)[0]))
        if distance > _FAR_M:
            raise InputError(
                f"{path}: half of the points of frame {frame + 1} are {distance:.2f} m or more from"
                f" the body, expected them within {_FAR_M} m (same axes, units and order of frames)"
            )


def read_body_parameters(path: str | Path, bodies: Mapping[str, BodyModel]) -> BodyParameters:
    """Read the body of scans; see `read_scans`. Axes stay as they are in the file.

    Raises:
        InputError: an array is missing, misshapen or not finite, or there is no such gender.
    """
    if not Path(path).is_file():
        raise InputError(
            f"{path}: no such file, expected an .npz with the body's poses, trans, shape and gender"
        )
    arrays = load_npz(path, "poses", "shape", "gender")
    place = next((key for key in ("trans", "transl") if key in arrays), None)
    if place is None:
        raise InputError(
            f"{path}: lacks trans; it holds {', '.join(sorted(arrays))},"
            " expected trans (root joint) or transl (SMPL's)"
        )
    frames = len(np.atleast_1d(arrays["poses"]))
    shapes = {"poses": (frames, 72), place: (frames, 3), "shape": (10,)}
    for key, wanted in shapes.items():
        value = arrays[key]
        if value.shape != wanted or value.dtype.kind not in "fiu":
            raise InputError(
                f"{path}: {key} has shape {value.shape} and type {value.dtype},"
                f" expected {wanted} numbers"
            )
        if not np.isfinite(value).all():
            raise InputError(f"{path}: {key} holds NaN or infinity, expected numbers")
    gender = _gender(path, arrays["gender"])
    if gender not in bodies:
        raise InputError(f"{path}: gender {gender}, expected {' or '.join(bodies)}")
    shape = arrays["shape"].astype(np.float64)
    trans = arrays[place].astype(np.float64)
    if place == "transl":
        trans = trans + shaped(bodies[gender], shape)[1][0]  # SMPL turns about the root joint
    return BodyParameters(arrays["poses"].astype(np.float64), trans, shape, gender)


def _gender(path: str | Path, value: np.ndarray) -> str:
    text = str(value.item() if value.size == 1 else value)
    if text in GENDERS:
        return text
    if text in {"0", "1"}:
        return GENDERS[int(text)]
    raise InputError(f"{path}: gender is '{text}', expected {GENDERS[0]}, {GENDERS[1]}, 0 or 1")


def read_frames(path: str | Path) -> list[Scan]:
    """Read scans, as they are in the files; see `read_scans`.

    Raises:
        InputError: there are none, a file is unreadable, or a frame is empty, not finite, or of a
            size that no person has.
    """
    path = Path(path)
    if path.is_dir():
        files = sorted((p for p in path.iterdir() if p.suffix in SUFFIXES), key=_natural)
        if not files:
            raise InputError(f"{path}: no {', '.join(SUFFIXES)} in it, expected one per frame")
        named = [(str(file), _read_frame(file)) for file in files]
    elif path.suffix == ".npz":
        named = [(f"{path}: frame {i + 1}", Scan(p, None)) for i, p in enumerate(_unpacked(path))]
    else:
        raise InputError(f"{path}: no such folder, expected scans in it, or one .npz with points")
    for name, scan in named:
        _check_scan(name, scan)
    return [scan for _, scan in named]


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sorting key by which frame 10 comes after frame 9."""
    return [
        (int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name)
    ]


def _unpacked(path: Path) -> list[np.ndarray]:
    """Points of every frame of one `.npz`."""
    arrays = load_npz(path, "points")
    points = arrays["points"]
    if points.dtype.kind not in "fiu":
        raise InputError(f"{path}: points are of type {points.dtype}, expected numbers")
    if "counts" not in arrays:
        if points.ndim != 3 or points.shape[2] != 3:
            raise InputError(
                f"{path}: points have shape {points.shape}, expected (F, P, 3),"
                " or (n, 3) with counts (F,)"
            )
        found = list(points)
    else:
        counts = arrays["counts"]
        if (
            points.ndim != 2
            or points.shape[1] != 3
            or counts.ndim != 1
            or counts.dtype.kind not in "iu"
            or (counts < 0).any()
            or counts.sum() != len(points)
        ):
            raise InputError(
                f"{path}: points have shape {points.shape} and counts {counts.shape} sum up to"
                f" {counts.sum()}, expected (n, 3) and counts of n in all"
            )
        found = np.split(points, np.cumsum(counts)[:-1])
    if not found:
        raise InputError(f"{path}: no frames, expected one or more")
    return found


def _read_frame(path: Path) -> Scan:
    if path.suffix == ".npz":
        arrays = load_npz(path)
        key = next((key for key in _POINT_KEYS if key in arrays), None)
        if key is None:
            raise InputError(
                f"{path}: holds {', '.join(sorted(arrays))}, expected {' or '.join(_POINT_KEYS)}"
            )
        return Scan(arrays[key], arrays.get("faces"))
    if path.suffix == ".obj":
        text = path.read_text(errors="replace")
        if re.search(r"^f\s", text, re.MULTILINE):
            mesh = load_obj(path)
            return Scan(mesh.vertices, mesh.triangles)
    try:
        found = trimesh.load(path, process=False)
    except Exception as error:  # trimesh raises whatever its parsers happen to raise
        raise InputError(f"{path}: not readable as {path.suffix[1:]} ({error})") from error
    vertices = np.asarray(getattr(found, "vertices", np.zeros((0, 3))))
    triangles = np.asarray(getattr(found, "faces", np.zeros((0, 3), int)))
    return Scan(vertices, triangles.astype(np.int32) if len(triangles) else None)


def _check_scan(name: str, scan: Scan) -> None:
    points, triangles = scan
    if points.dtype.kind not in "fiu" or points.ndim != 2 or points.shape[1] != 3:
        raise InputError(
            f"{name}: points have shape {points.shape} and type {points.dtype},"
            " expected (n, 3) numbers"
        )
    if not len(points):
        raise InputError(f"{name}: no points, expected one or more")
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        raise InputError(
            f"{name}: {int((~finite).sum())} of {len(points)} points hold NaN or infinity, the"
            f" first is point {int(np.argmin(finite)) + 1}; expected metres"
        )
    if triangles is not None and (
        triangles.ndim != 2
        or triangles.shape[1] != 3
        or triangles.dtype.kind not in "iu"
        or triangles.min(initial=0) < 0
        or triangles.max(initial=0) >= len(points)
    ):
        raise InputError(
            f"{name}: faces do not fit {len(points)} vertices, expected (F, 3) vertex numbers"
        )
    # Two in a hundred may be stray points of a scanner.
    low, high = np.percentile(points, (1, 99), axis=0)
    size = float((high - low).max())
    if not _TINY_M < size < _HUGE_M:
        unit = " (millimetres?)" if size > 500 else " (centimetres?)" if size > 20 else ""
        raise InputError(
            f"{name}: the scan is {size:.4g} m large{unit},"
            f" expected metres, between {_TINY_M} and {_HUGE_M}"
        )
