"""Moving meshes of glTF 2.0 files by any program: morph targets, skins and moving nodes."""

import base64
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from drapeline.dataset.scene_part import PLAIN_COLOUR, ScenePart
from drapeline.errors import DamagedFile, InputError, refuse_damage
from drapeline.frames import FPS
from drapeline.geometry.mesh import Mesh
from drapeline.storage import parse_json

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_TRIANGLES = 4
# Extensions that leave vertices where they are, and the one that stores them as integers.
_KNOWN = ("KHR_mesh_quantization", "KHR_materials_", "KHR_texture_", "KHR_lights_")
_MOST_FRAMES = 20_000
_MOST_ELEMENTS = 50_000_000
_PATHS = {"translation": 3, "rotation": 4, "scale": 3, "weights": 0}


def read_gltf(path: str | Path, fps: float = FPS) -> list[ScenePart]:
    """Read every mesh of a scene in motion, in the file's own axes.

    Vertices that coincide in all that moves them, as at seams of a texture, become one.

    Args:
        path: `.glb`, or `.gltf` with its buffers beside it or inside.
        fps: frames per second to sample the animations at, which all play at once.

    Raises:
        InputError: the file is damaged, or uses an extension that changes shapes.
    """
    path = Path(path)
    with refuse_damage(path, "glTF"):
        return _Scene(path, fps).parts()


class _Track(NamedTuple):
    """What an animation does to a property of a node."""

    times: np.ndarray  # (k,)
    values: np.ndarray  # (k, n), or (k, 3, n) of a cubic spline
    kind: str  # "LINEAR", "STEP" or "CUBICSPLINE"

    def at(self, times: np.ndarray, *, turns: bool) -> np.ndarray:
        """(F, n) values."""
        times = np.clip(times, self.times[0], self.times[-1])
        before = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, None)
        if len(self.times) == 1 or self.kind == "STEP":
            return self.values[before]
        before = np.minimum(before, len(self.times) - 2)
        span = self.times[before + 1] - self.times[before]
        share = ((times - self.times[before]) / span)[:, None]
        if self.kind == "CUBICSPLINE":
            return self._spline(before, share, span[:, None])
        if turns:
            return Slerp(self.times, Rotation.from_quat(self.values))(times).as_quat()
        return (1 - share) * self.values[before] + share * self.values[before + 1]

    def _spline(self, before: np.ndarray, t: np.ndarray, span: np.ndarray) -> np.ndarray:
        """Hermite's, as appendix C of the specification has it."""
        start, out = self.values[before, 1], span * self.values[before, 2]
        end, into = self.values[before + 1, 1], span * self.values[before + 1, 0]
        square, cube = t**2, t**3
        return (
            (2 * cube - 3 * square + 1) * start
            + (cube - 2 * square + t) * out
            + (3 * square - 2 * cube) * end
            + (cube - square) * into
        )


class _Scene:
    def __init__(self, path: Path, fps: float) -> None:
        self._path = path
        self._json, self._binary = _load(path)
        for name in self._json.get("extensionsRequired", []):
            if not name.startswith(_KNOWN):
                raise InputError(f"{path}: needs {name!r:.60}, expected plain meshes")
        self._buffers: dict[int, bytes] = {}
        self._tracks: dict[tuple[int, str], _Track] = {}
        for animation in self._json.get("animations", []):
            for channel in animation["channels"]:
                self._take(animation["samplers"][channel["sampler"]], channel["target"])
        end = max((track.times[-1] for track in self._tracks.values()), default=0.0)
        start = min((track.times[0] for track in self._tracks.values()), default=0.0)
        count = round(float(end - start) * fps) + 1
        if count > _MOST_FRAMES:
            raise InputError(f"{path}: {count} frames, expected at most {_MOST_FRAMES}")
        self._times = start + np.arange(count) / fps
        self._world: dict[int, np.ndarray] = {}

    def _take(self, sampler: dict[str, Any], target: dict[str, Any]) -> None:
        if "node" not in target or target["path"] not in _PATHS:
            return
        times = self.accessor(sampler["input"])[:, 0].astype(np.float64)
        values = self.accessor(sampler["output"]).astype(np.float64)
        kind = sampler.get("interpolation", "LINEAR")
        rows = 3 * len(times) if kind == "CUBICSPLINE" else len(times)
        width = values.size // rows
        shape = (len(times), 3, width) if kind == "CUBICSPLINE" else (len(times), width)
        track = _Track(times, values.reshape(shape), kind)
        self._tracks[target["node"], target["path"]] = track

    def parts(self) -> list[ScenePart]:
        parents = {
            child: node
            for node, about in enumerate(self._json.get("nodes", []))
            for child in about.get("children", [])
        }
        names: dict[str, int] = {}
        found = []
        for node, about in enumerate(self._json.get("nodes", [])):
            if "mesh" not in about:
                continue
            mesh = self._json["meshes"][about["mesh"]]
            name = about.get("name") or mesh.get("name") or f"mesh{about['mesh']}"
            names[name] = names.get(name, 0) + 1
            if names[name] > 1:
                name = f"{name}_{names[name]}"
            found.append(self._part(name, node, mesh, parents))
        if not found:
            raise InputError(f"{self._path}: has no mesh, expected a body or a garment")
        return found

    def _part(
        self, name: str, node: int, mesh: dict[str, Any], parents: dict[int, int]
    ) -> ScenePart:
        about = self._json["nodes"][node]
        first = np.array(about.get("weights") or mesh.get("weights") or [], dtype=np.float64)
        track = self._tracks.get((node, "weights"))
        weights = np.tile(first, (len(self._times), 1))
        if track is not None:
            weights = track.at(self._times, turns=False)
        points, faces, skinned = [], [], []
        start = 0
        for primitive in mesh["primitives"]:
            if primitive.get("mode", _TRIANGLES) != _TRIANGLES:
                raise InputError(f"{self._path}: {name} is not of triangles, expected triangles")
            one = _Primitive(self, primitive)
            points.append(one.moved(weights))
            faces.append(start + one.faces)
            skinned.append((one.joints, one.weights))
            start += len(one.base)
        moving = np.concatenate(points, axis=1)
        if "skin" in about:
            moving = self._skin(moving, self._json["skins"][about["skin"]], skinned, parents)
        else:
            matrix = self._matrices(node, parents)
            moving = np.einsum("fij,fvj->fvi", matrix[:, :3, :3], moving) + matrix[:, None, :3, 3]
        return _welded(name, moving.astype(np.float32), np.concatenate(faces))

    def _skin(
        self,
        moving: np.ndarray,
        skin: dict[str, Any],
        skinned: list[tuple[np.ndarray, np.ndarray]],
        parents: dict[int, int],
    ) -> np.ndarray:
        joints = skin["joints"]
        inverse = np.tile(np.eye(4), (len(joints), 1, 1))
        if "inverseBindMatrices" in skin:
            stored = self.accessor(skin["inverseBindMatrices"]).reshape(-1, 4, 4)
            inverse = stored.transpose(0, 2, 1).astype(np.float64)
        # (F, J, 4, 4)
        matrices = np.stack([self._matrices(joint, parents) for joint in joints], axis=1) @ inverse
        numbers = np.concatenate([numbers for numbers, _ in skinned])
        weights = np.concatenate([weights for _, weights in skinned])
        weights = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)
        out = np.zeros_like(moving)
        for frame, matrix in enumerate(matrices):
            blend = np.einsum("vk,vkij->vij", weights, matrix[numbers][..., :3, :])
            out[frame] = np.einsum("vij,vj->vi", blend[..., :3], moving[frame]) + blend[..., 3]
        return out

    def _matrices(self, node: int, parents: dict[int, int]) -> np.ndarray:
        """(F, 4, 4) from a node's own axes to the scene's."""
        if node not in self._world:
            self._world[node] = np.eye(4)[None]  # for a node that is its own parent
            own = self._local(node)
            if node in parents:
                own = self._matrices(parents[node], parents) @ own
            self._world[node] = own
        return self._world[node]

    def _local(self, node: int) -> np.ndarray:
        about = self._json["nodes"][node]
        count = len(self._times)
        matrix = np.tile(np.eye(4), (count, 1, 1))
        if "matrix" in about:
            return np.tile(np.reshape(about["matrix"], (4, 4)).T.astype(np.float64), (count, 1, 1))
        still = {"translation": [0, 0, 0], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}
        values = {}
        for path, value in still.items():
            track = self._tracks.get((node, path))
            values[path] = (
                np.tile(np.array(about.get(path, value), dtype=np.float64), (count, 1))
                if track is None
                else track.at(self._times, turns=path == "rotation")
            )
        turn = Rotation.from_quat(values["rotation"]).as_matrix()
        matrix[:, :3, :3] = turn * values["scale"][:, None]
        matrix[:, :3, 3] = values["translation"]
        return matrix

    def accessor(self, number: int) -> np.ndarray:
        """(n, k) numbers; normalised integers are from -1 or 0 to 1."""
        about = self._json["accessors"][number]
        dtype, width = np.dtype(_TYPES[about["componentType"]]), _WIDTHS[about["type"]]
        count = about["count"]
        if not 0 < count <= _MOST_ELEMENTS:
            raise DamagedFile(
                self._path, f"an accessor of {count} elements, expected 1 to 50 million"
            )
        values = np.zeros((count, width), dtype)
        if "bufferView" in about:
            values = self._view(
                about["bufferView"], about.get("byteOffset", 0), count, width, dtype
            )
        if "sparse" in about:
            values = values.copy()
            sparse = about["sparse"]
            where, what = sparse["indices"], sparse["values"]
            rows = self._view(
                where["bufferView"],
                where.get("byteOffset", 0),
                sparse["count"],
                1,
                np.dtype(_TYPES[where["componentType"]]),
            )
            values[rows[:, 0]] = self._view(
                what["bufferView"], what.get("byteOffset", 0), sparse["count"], width, dtype
            )
        if about.get("normalized"):
            return np.maximum(values / np.iinfo(dtype).max, -1.0)
        return values

    def _view(
        self, number: int, offset: int, count: int, width: int, dtype: np.dtype
    ) -> np.ndarray:
        view = self._json["bufferViews"][number]
        stride = view.get("byteStride", width * dtype.itemsize)
        data = self._buffer(view["buffer"])
        start = view.get("byteOffset", 0) + offset
        last = start + (count - 1) * stride + width * dtype.itemsize
        end = min(len(data), start - offset + view["byteLength"])
        if min(start, offset, stride) < 0 or last > end:
            raise DamagedFile(self._path, "is cut off, expected all of its buffers")
        return np.ndarray((count, width), dtype, data, start, (stride, dtype.itemsize))

    def _buffer(self, number: int) -> bytes:
        if number not in self._buffers:
            uri = self._json["buffers"][number].get("uri")
            self._buffers[number] = self._binary if uri is None else _resource(self._path, uri)
        return self._buffers[number]


class _Primitive:
    """Triangles of a mesh that share a material."""

    def __init__(self, scene: _Scene, about: dict[str, Any]) -> None:
        attributes = about["attributes"]
        self.base = scene.accessor(attributes["POSITION"]).astype(np.float64)
        self._targets = [
            scene.accessor(target["POSITION"]) if "POSITION" in target else None
            for target in about.get("targets", [])
        ]
        corners = (
            scene.accessor(about["indices"])[:, 0]
            if "indices" in about
            else np.arange(len(self.base))
        )
        self.faces = corners.astype(np.int64).reshape(-1, 3)
        if len(self.faces) and self.faces.max() >= len(self.base):
            raise IndexError("a triangle names a vertex that is not there")
        sets = [k for k in range(4) if f"JOINTS_{k}" in attributes]
        self.joints = np.zeros((len(self.base), 4), np.int64)
        self.weights = np.tile([1.0, 0, 0, 0], (len(self.base), 1))
        if sets:
            self.joints = np.hstack(
                [scene.accessor(attributes[f"JOINTS_{k}"]).astype(np.int64) for k in sets]
            )
            self.weights = np.hstack(
                [scene.accessor(attributes[f"WEIGHTS_{k}"]).astype(np.float64) for k in sets]
            )

    def moved(self, weights: np.ndarray) -> np.ndarray:
        """(F, V, 3) by morph targets with weights (F, T)."""
        out = np.tile(self.base, (len(weights), 1, 1))
        for target, track in zip(self._targets, weights.T, strict=True):
            if target is not None:
                on = np.flatnonzero(track)
                out[on] += track[on, None, None] * target
        return out


def _welded(name: str, moving: np.ndarray, faces: np.ndarray) -> ScenePart:
    """A part in which vertices that are together in all frames are one."""
    some = moving[:: max(1, len(moving) // 8)]
    rows = np.ascontiguousarray(some.transpose(1, 0, 2).reshape(moving.shape[1], -1))
    _, first, place = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    faces = place.reshape(-1)[faces]
    distinct = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    points = np.ascontiguousarray(moving[:, first])
    mesh = Mesh(points[0], np.ascontiguousarray(faces[distinct], dtype=np.int32))
    return ScenePart(name, mesh, PLAIN_COLOUR, lambda start, stop: points[start:stop], len(points))


def _load(path: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON of a file, and what is packed behind it."""
    data = path.read_bytes()
    if data[:4] != b"glTF":
        return _object(path, data), b""
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2 or length > len(data):
        raise DamagedFile(path, f"is cut off or of version {version}, expected all of glTF 2.0")
    chunks = dict(_chunks(data))
    return _object(path, chunks.get(b"JSON", b"")), chunks.get(b"BIN\0", b"")


def _object(path: Path, text: bytes) -> dict[str, Any]:
    found = parse_json(text.decode())
    if not isinstance(found, dict) or "asset" not in found:
        raise DamagedFile(path, "is no glTF file, expected its JSON with an 'asset'")
    return found


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    place = 12
    while place + 8 <= len(data):
        size, kind = struct.unpack_from("<I4s", data, place)
        yield kind, data[place + 8 : place + 8 + size]
        place += 8 + size


def _resource(path: Path, uri: str) -> bytes:
    if uri.startswith("data:"):
        return base64.b64decode(uri.partition(",")[2])
    file = path.parent / unquote(uri)
    if ":" in uri.split("/")[0] or path.parent.resolve() not in file.resolve().parents:
        raise InputError(f"{path}: names the buffer {uri!r:.80}, expected a file beside it")
    return file.read_bytes()
