"""Read a user's scans: point clouds or meshes of a dressed person, and the known body.

Frames are a folder of `.ply`, `.obj` or `.npz` files in the order of their names, or a single
`.npz` with all of them. The body is an `.npz` with its parameters. Both are checked on reading,
because a network gives some answer to any input, even if it is in millimetres, lies on its side or
is late by a frame.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from drapeline.bodies.model import BodyModel, posed_vertices, shape_body
from drapeline.errors import InputError, refuse_damage
from drapeline.frames import FPS, GENDERS
from drapeline.geometry.obj import load_obj
from drapeline.seeding import rng_for
from drapeline.storage import load_npz

SUFFIXES = (".ply", ".obj", ".npz")
_MIN_SIZE_M, _MAX_SIZE_M = 0.2, 4.0  # of a scanned person, arms and hair included
_MAX_MEDIAN_DISTANCE_M = 0.15  # from the points of a dressed person to the body
_CHECKED_POINTS = 500  # points per frame that are compared with the body
# Keys under which the `.npz` of a single frame may hold its points; CAPE uses the second.
_POINT_KEYS = ("points", "v_posed", "vertices")


class Scan(NamedTuple):
    """The scan of one frame."""

    points: np.ndarray  # (n, 3) float32 metres
    triangles: np.ndarray | None  # (F, 3) int32 if the scan is a mesh, else None
    labels: np.ndarray | None = None  # (n,) integers of a segmented scan, else None


@dataclass(frozen=True)
class BodyParameters:
    """A known body in motion, in metres, Z up."""

    poses: np.ndarray  # (F, 72) axis-angle in radians
    trans: np.ndarray  # (F, 3) positions of the root joint
    shape: np.ndarray  # (10,) shape coefficients
    gender: str  # "female" or "male"
    joints: np.ndarray | None = None  # (F, 24, 3) predicted positions of the joints, or None


@dataclass(frozen=True)
class ScanSequence:
    """Scans of a person, with the person's body."""

    scans: tuple[Scan, ...]  # F frames in metres, relative to the root joint, Z up
    body: BodyParameters  # parameters of the body in the same frames

    def __len__(self) -> int:
        return len(self.scans)

    def points(self, count: int, *, seed: int) -> np.ndarray:
        """Draw `count` points from every frame, in random order: (F, P, 3) float32.

        Meshes are sampled uniformly by area. Points of clouds are dropped or repeated as needed.
        """
        return np.stack(
            [
                _resample(scan, count, rng_for(seed, "scan", frame))
                for frame, scan in enumerate(self.scans)
            ]
        )


def _resample(scan: Scan, count: int, rng: np.random.Generator) -> np.ndarray:
    if scan.triangles is None:
        available = len(scan.points)
        order = [rng.permutation(available) for _ in range(-(-count // available))]
        return rng.permutation(scan.points[np.concatenate(order)[:count]])
    a, b, c = (scan.points[scan.triangles[:, i]] for i in range(3))
    cumulative_area = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1), dtype=np.float64)
    face = np.searchsorted(cumulative_area, cumulative_area[-1] * rng.random(count), side="right")
    face = np.minimum(face, len(cumulative_area) - 1)
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
    """Read scans and their body at 30 frames per second, and check that they match.

    Args:
        frames: folder of `.ply`, `.obj` or `.npz` files, or a single `.npz` with `points`
            (F, P, 3), or with the `points` (n, 3) of all frames and the `counts` (F,) of points
            per frame; world coordinates in metres. Segmented scans have an integer `label` for
            each vertex of a `.ply`, or `labels` (n,) or (F, P) in an `.npz`.
        parameters: `.npz` with `poses` (F, 72) in radians, `shape` (10,), `gender` ("female",
            "male", 0 or 1) and either `trans` (F, 3), world positions of the root joint, or
            `transl` (F, 3), SMPL's translation of the body; `joints` (F, 24, 3) if they were
            predicted apart from the pose.
        bodies: body models by gender.
        up: the axis that points up in both files; "y" for CAPE.
        fps: frames per second of both files, a multiple of 30; every (fps / 30)-th frame is kept.
            60 for CAPE.

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
            " expected equal numbers"
        )
    step = fps // FPS
    scans = scans[::step]
    joints = None if body.joints is None else body.joints[::step]
    body = replace(body, poses=body.poses[::step], trans=body.trans[::step], joints=joints)
    if up == "y":
        scans = [scan._replace(points=_to_z_up(scan.points)) for scan in scans]
        body = _turn_to_z_up(body)
    return _place_on_body(frames, scans, body, bodies)


def to_scans(
    points: Sequence[np.ndarray] | np.ndarray,
    parameters: Mapping[str, object],
    bodies: Mapping[str, BodyModel],
    *,
    labels: Sequence[np.ndarray] | None = None,
    name: str = "points",
) -> ScanSequence:
    """The same of arrays: point clouds at 30 frames per second, Z up.

    Args:
        points: F clouds (n, 3), world coordinates in metres; n may differ.
        parameters: of the body, by the keys that `read_scans` describes; a `trans` of None is the
            origin in all frames.
        bodies: body models by gender.
        labels: F arrays (n,) of integers, if the clouds are segmented.
        name: of the clouds, for errors.

    Raises:
        InputError: says what is wrong and what was expected.
    """
    given = [None] * len(points) if labels is None else map(np.asarray, labels)
    scans = [
        Scan(np.asarray(cloud), None, label) for cloud, label in zip(points, given, strict=True)
    ]
    for frame, scan in enumerate(scans, 1):
        _check_scan(f"{name}: frame {frame}", scan)
    arrays = {key: np.asarray(value) for key, value in parameters.items()}
    if parameters.get("trans", "") is None:
        arrays["trans"] = np.zeros((len(np.atleast_1d(arrays["poses"])), 3))
    body = _parse_body_parameters(f"{name}: the body", arrays, bodies)
    if len(scans) != len(body.poses):
        raise InputError(
            f"{name}: {len(scans)} frames, but {len(body.poses)} poses; expected equal numbers"
        )
    return _place_on_body(name, scans, body, bodies)


def _place_on_body(
    name: str | Path, scans: list[Scan], body: BodyParameters, bodies: Mapping[str, BodyModel]
) -> ScanSequence:
    """Scans relative to the root joint, once they are known to be near the body."""
    points = [scan.points - root for scan, root in zip(scans, body.trans, strict=True)]
    _check_distance(name, points, body, bodies[body.gender])
    return ScanSequence(
        tuple(
            scan._replace(points=relative.astype(np.float32))
            for relative, scan in zip(points, scans, strict=True)
        ),
        body,
    )


def _to_z_up(points: np.ndarray) -> np.ndarray:
    """Convert points (..., 3) from Y up to Z up: a quarter turn about X."""
    return np.stack([points[..., 0], -points[..., 2], points[..., 1]], axis=-1)


def _turn_to_z_up(body: BodyParameters) -> BodyParameters:
    turn = Rotation.from_euler("x", 90, degrees=True)
    poses = body.poses.copy()
    poses[:, :3] = (turn * Rotation.from_rotvec(poses[:, :3])).as_rotvec()
    joints = None if body.joints is None else _to_z_up(body.joints)
    return replace(body, poses=poses, trans=_to_z_up(body.trans), joints=joints)


def _check_distance(
    path: str | Path, points: list[np.ndarray], body: BodyParameters, model: BodyModel
) -> None:
    """Refuse clouds that are far from the body, such as in another frame of reference or time."""
    for frame in sorted({0, len(points) // 2, len(points) - 1}):
        posed, _ = posed_vertices(model, body.shape, body.poses[frame : frame + 1])
        subset = points[frame][:: max(len(points[frame]) // _CHECKED_POINTS, 1)]
        distance = float(np.median(KDTree(posed[0]).query(subset)[0]))
        if distance > _MAX_MEDIAN_DISTANCE_M:
            raise InputError(
                f"{path}: half of the points of frame {frame + 1} are {distance:.2f} m or more from"
                f" the body, expected at most {_MAX_MEDIAN_DISTANCE_M} m (the same axes, units and"
                " order of frames)"
            )


# What is wrong with these is told in more words below.
_PARAMETERS = {
    **dict.fromkeys(("poses", "shape", "gender", "trans?", "transl?", "joints?"), "any|nan ...")
}


def read_body_parameters(path: str | Path, bodies: Mapping[str, BodyModel]) -> BodyParameters:
    """Read the body of scans as described at `read_scans`, with the axes of the file.

    Raises:
        InputError: an array is missing, has the wrong shape or is not finite, or there is no body
            model for the gender.
    """
    if not Path(path).is_file():
        raise InputError(
            f"{path}: no such file, expected an .npz with the body's poses, trans, shape and gender"
        )
    return _parse_body_parameters(path, load_npz(path, _PARAMETERS), bodies)


def _parse_body_parameters(
    path: str | Path, arrays: Mapping[str, np.ndarray], bodies: Mapping[str, BodyModel]
) -> BodyParameters:
    trans_key = next((key for key in ("trans", "transl") if key in arrays), None)
    if trans_key is None:
        raise InputError(
            f"{path}: lacks trans; it holds {', '.join(sorted(arrays))},"
            " expected trans (root joint) or transl (SMPL's)"
        )
    frames = len(np.atleast_1d(arrays["poses"]))
    shapes = {"poses": (frames, 72), trans_key: (frames, 3), "shape": (10,)}
    if "joints" in arrays:
        shapes["joints"] = (frames, 24, 3)
    for key, expected in shapes.items():
        value = arrays[key]
        if value.shape != expected or value.dtype.kind not in "fiu":
            raise InputError(
                f"{path}: {key} has shape {value.shape} and type {value.dtype},"
                f" expected {expected} numbers"
            )
        if not np.isfinite(value).all():
            raise InputError(f"{path}: {key} holds NaN or infinity, expected finite numbers")
    gender = _gender(path, arrays["gender"])
    if gender not in bodies:
        raise InputError(f"{path}: gender {gender}, expected {' or '.join(bodies)}")
    shape = arrays["shape"].astype(np.float64)
    trans = arrays[trans_key].astype(np.float64)
    if trans_key == "transl":
        trans = trans + shape_body(bodies[gender], shape)[1][0]  # SMPL turns about the root joint
    joints = arrays["joints"].astype(np.float64) if "joints" in arrays else None
    return BodyParameters(arrays["poses"].astype(np.float64), trans, shape, gender, joints)


def _gender(path: str | Path, value: np.ndarray) -> str:
    text = str(value.item() if value.size == 1 else value)
    if text in GENDERS:
        return text
    if text in {"0", "1"}:
        return GENDERS[int(text)]
    raise InputError(f"{path}: gender is '{text}', expected {GENDERS[0]}, {GENDERS[1]}, 0 or 1")


def read_frames(path: str | Path) -> list[Scan]:
    """Read scans as they are in the files, described at `read_scans`.

    Raises:
        InputError: there are no scans, a file is unreadable, or a frame is empty, not finite, or
            too small or too large for a person.
    """
    path = Path(path)
    if path.is_dir():
        shown = (file for file in path.iterdir() if not file.name.startswith("."))
        files = sorted((f for f in shown if f.suffix in SUFFIXES), key=_natural_sort_key)
        if not files:
            raise InputError(f"{path}: contains no {', '.join(SUFFIXES)}, expected one per frame")
        scans = {str(file): _read_frame(file) for file in files}
    elif path.suffix == ".npz":
        scans = {f"{path}: frame {i}": scan for i, scan in enumerate(_read_frames(path), 1)}
    else:
        raise InputError(f"{path}: no such folder, expected a folder of scans or an .npz of points")
    for name, scan in scans.items():
        _check_scan(name, scan)
    return [
        scan if scan.triangles is None else scan._replace(triangles=scan.triangles.astype(np.int32))
        for scan in scans.values()
    ]


def _natural_sort_key(path: Path) -> list[tuple[int, str]]:
    """Sort frame 10 after frame 9."""
    return [
        (int(part), "") if part.isdecimal() else (-1, part)
        for part in re.split(r"(\d+)", path.name)
    ]


def _read_frames(path: Path) -> list[Scan]:
    """Points of all frames in a single `.npz`, with their labels if it has some."""
    arrays = load_npz(path, dict.fromkeys(("points", "counts?", "labels?"), "any|nan ..."))
    points = arrays["points"]
    if points.dtype.kind not in "fiu":
        raise InputError(f"{path}: points are of type {points.dtype}, expected numbers")
    if "counts" not in arrays:
        if points.ndim != 3 or points.shape[2] != 3:
            raise InputError(
                f"{path}: points have shape {points.shape}, expected (F, P, 3),"
                " or (n, 3) with counts (F,)"
            )
        ends = None
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
                f" {counts.sum()}, expected (n, 3) and counts that sum up to n"
            )
        ends = np.cumsum(counts)[:-1]
    if not len(points if ends is None else arrays["counts"]):
        raise InputError(f"{path}: no frames, expected at least one")
    labels = arrays.get("labels")
    if labels is not None and labels.shape != points.shape[:-1]:
        raise InputError(
            f"{path}: labels have shape {labels.shape}, expected {points.shape[:-1]}, one for each"
            " point"
        )
    frames = _split(points, ends)
    parts = [None] * len(frames) if labels is None else _split(labels, ends)
    return [Scan(frame, None, part) for frame, part in zip(frames, parts, strict=True)]


def _split(array: np.ndarray, ends: np.ndarray | None) -> list[np.ndarray]:
    """Frames of an array (F, P, ...), or of one (n, ...) that they end at."""
    return list(array) if ends is None else np.split(array, ends)


def _read_frame(path: Path) -> Scan:
    if path.suffix == ".npz":
        arrays = load_npz(
            path, {f"{key}?": "any|nan ..." for key in (*_POINT_KEYS, "faces", "labels")}
        )
        key = next((key for key in _POINT_KEYS if key in arrays), None)
        if key is None:
            raise InputError(f"{path}: holds neither {' nor '.join(_POINT_KEYS)}")
        return Scan(arrays[key], arrays.get("faces"), arrays.get("labels"))
    if path.suffix == ".obj":
        with refuse_damage(path, "obj"):
            text = path.read_text(errors="replace")
        if re.search(r"^f\s", text, re.MULTILINE):
            mesh = load_obj(path)
            return Scan(mesh.vertices, mesh.triangles)
    declared = _ply_counts(path) if path.suffix == ".ply" else {}
    import trimesh  # here, because no other scans than users' files need it

    with refuse_damage(path, path.suffix[1:]):
        geometry = trimesh.load(path, process=False)
        vertices = np.asarray(getattr(geometry, "vertices", np.zeros((0, 3))))
        triangles = np.asarray(getattr(geometry, "faces", np.zeros((0, 3), int)))
        labels = _ply_labels(geometry)
    for name, found in (("vertex", len(vertices)), ("face", len(triangles))):
        if found < declared.get(name, 0):  # polygons become several triangles
            raise InputError(
                f"{path}: names {declared[name]} elements of '{name}' and holds {found}, expected"
                " all of them: the file may be cut off"
            )
    return Scan(vertices, triangles if len(triangles) else None, labels)


_PLY_ELEMENT = re.compile(rb"element[ \t]+(\S+)[ \t]+(\S+)")


def _ply_counts(path: Path) -> dict[str, int]:
    """Declared counts of elements; at most the size in bytes: trimesh takes memory for all."""
    with refuse_damage(path, "ply"), open(path, "rb") as stream:
        head = stream.read(1 << 16)
    size = path.stat().st_size
    counts = {}
    for name, count in _PLY_ELEMENT.findall(head[: head.find(b"end_header")]):
        if not count.isdigit() or len(count) > 18 or int(count) > size:
            raise InputError(
                f"{path}: names {count.decode('latin-1')} elements in {size} bytes, expected fewer"
            )
        counts[name.decode("latin-1")] = int(count)
    return counts


def _ply_labels(geometry: Any) -> np.ndarray | None:
    """(n,) the property `label` of a `.ply`'s vertices; None if there is none."""
    data = geometry.metadata.get("_ply_raw", {}).get("vertex", {}).get("data")
    # Columns by name in text files, records in binary ones.
    names = data if isinstance(data, Mapping) else getattr(data, "dtype", np.dtype(int)).names or ()
    return np.asarray(data["label"]).ravel() if "label" in names else None


def _check_scan(name: str, scan: Scan) -> None:
    points, triangles, labels = scan
    if points.dtype.kind not in "fiu" or points.ndim != 2 or points.shape[1] != 3:
        raise InputError(
            f"{name}: points have shape {points.shape} and type {points.dtype},"
            " expected (n, 3) numbers"
        )
    if not len(points):
        raise InputError(f"{name}: no points, expected at least one")
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        raise InputError(
            f"{name}: {int((~finite).sum())} of {len(points)} points hold NaN or infinity (the"
            f" first is point {int(np.argmin(finite)) + 1}), expected finite positions in metres"
        )
    if triangles is not None and (
        triangles.ndim != 2
        or triangles.shape[1] != 3
        or triangles.dtype.kind not in "iu"
        or triangles.min(initial=0) < 0
        or triangles.max(initial=0) >= len(points)
    ):
        raise InputError(
            f"{name}: the faces do not match the {len(points)} vertices, expected (F, 3) indices"
        )
    if labels is not None and (labels.shape != (len(points),) or labels.dtype.kind not in "iu"):
        raise InputError(
            f"{name}: labels have shape {labels.shape} and type {labels.dtype}, expected"
            f" {len(points)} integers, one for each point"
        )
    # Up to two percent of the points may be outliers of the scanner.
    low, high = np.percentile(points, (1, 99), axis=0)
    size = float((high - low).max())
    if not _MIN_SIZE_M < size < _MAX_SIZE_M:
        unit = " (millimetres?)" if size > 500 else " (centimetres?)" if size > 20 else ""
        raise InputError(
            f"{name}: the scan is {size:.4g} m large{unit},"
            f" expected metres, between {_MIN_SIZE_M} and {_MAX_SIZE_M}"
        )
