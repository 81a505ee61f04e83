"""Write animated meshes to a binary glTF 2.0 file with one morph target per frame.

This does not use Blender's exporter, which loads the whole animation into memory and makes
Blender's Python module hang at exit.
"""

import json
import shutil
import struct
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from drapeline import __version__
from drapeline.dataset.scene_part import ScenePart, to_y_up
from drapeline.frames import FPS
from drapeline.geometry.mesh import triangulate, vertex_normals
from drapeline.storage import atomic_file

_FLOAT, _UINT32 = 5126, 5125
_VERTEX_DATA, _INDEX_DATA = 34962, 34963
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}


def write_glb(path: str | Path, parts: Sequence[ScenePart]) -> None:
    """Write parts, Y up and in metres, with normals, texture coordinates and plain colours.

    Frame 0 is the base mesh. Each later frame is a morph target with weight 1 at its own time and
    0 at the times of the other frames, interpolated linearly. Memory use does not grow with the
    number of frames.

    Args:
        path: the `.glb` file.
        parts: parts of one sample, all with the same number of frames.
    """
    with tempfile.TemporaryFile() as binary:
        asset = _Asset(binary)
        for part in parts:
            asset.add_part(part)
        document = json.dumps(asset.document(), separators=(",", ":")).encode()
        document += b" " * (-len(document) % 4)
        length = binary.tell()
        binary.seek(0)
        with atomic_file(path) as scratch, open(scratch, "wb") as stream:
            stream.write(struct.pack("<4sII", b"glTF", 2, 28 + len(document) + length))
            stream.write(struct.pack("<I4s", len(document), b"JSON") + document)
            stream.write(struct.pack("<I4s", length, b"BIN\0"))
            shutil.copyfileobj(binary, stream, 1 << 20)


class _Asset:
    """The JSON of a glTF file, built up along with the binary data that it describes."""

    def __init__(self, binary: BinaryIO) -> None:
        self._binary = binary
        self._lists: dict[str, list[dict[str, Any]]] = {
            name: [] for name in ("nodes", "meshes", "materials", "accessors", "bufferViews")
        }
        self._samplers: list[dict[str, Any]] = []
        self._times: int | None = None

    def document(self) -> dict[str, Any]:
        document = {
            "asset": {"version": "2.0", "generator": f"drapeline {__version__}"},
            "scene": 0,
            "scenes": [{"nodes": list(range(len(self._lists["nodes"])))}],
            **self._lists,
            "buffers": [{"byteLength": self._binary.tell()}],
        }
        if self._samplers:
            document["animations"] = [
                {
                    "name": "sequence",
                    "samplers": self._samplers,
                    "channels": [
                        {"sampler": node, "target": {"node": node, "path": "weights"}}
                        for node in range(len(self._samplers))
                    ],
                }
            ]
        return document

    def add_part(self, part: ScenePart) -> None:
        source, uv, triangles = _split_at_seams(part)
        faces = triangulate(part.mesh.faces)
        targets, base = [], None
        for points in part.frames():
            normals = to_y_up(vertex_normals(points, faces))[source]
            points = to_y_up(points)[source]
            if base is None:
                base = points, normals
                attributes = self._positions_and_normals(points, normals)
            else:
                targets.append(self._positions_and_normals(points - base[0], normals - base[1]))
        if uv is not None:
            attributes["TEXCOORD_0"] = self._add(uv, "VEC2", _VERTEX_DATA)
        primitive: dict[str, Any] = {
            "attributes": attributes,
            "indices": self._add(triangles.reshape(-1, 1), "SCALAR", _INDEX_DATA),
            "material": len(self._lists["materials"]),
        }
        mesh: dict[str, Any] = {"name": part.name, "primitives": [primitive]}
        if targets:
            primitive["targets"] = targets
            mesh["weights"] = [0.0] * len(targets)
            mesh["extras"] = {"targetNames": [f"{f:04d}" for f in range(1, len(targets) + 1)]}
            self._animate(len(targets))
        self._lists["materials"].append(_material(part))
        self._lists["nodes"].append({"name": part.name, "mesh": len(self._lists["meshes"])})
        self._lists["meshes"].append(mesh)

    def _animate(self, target_count: int) -> None:
        if self._times is None:
            times = np.arange(target_count + 1, dtype=np.float32)[:, None] / FPS
            self._times = self._add(times, "SCALAR", None, bounds=True)
        weights = np.eye(target_count + 1, dtype=np.float32)[:, 1:]
        output = self._add(weights.reshape(-1, 1), "SCALAR", None)
        self._samplers.append({"input": self._times, "output": output, "interpolation": "LINEAR"})

    def _positions_and_normals(self, points: np.ndarray, normals: np.ndarray) -> dict[str, int]:
        return {
            "POSITION": self._add(points, "VEC3", _VERTEX_DATA, bounds=True),
            "NORMAL": self._add(normals, "VEC3", _VERTEX_DATA),
        }

    def _add(
        self, values: np.ndarray, kind: str, target: int | None, *, bounds: bool = False
    ) -> int:
        """Append an array (n, components) to the binary and return its accessor's index."""
        is_index = values.dtype.kind in "iu"
        values = np.ascontiguousarray(values, dtype="<u4" if is_index else "<f4")
        assert values.shape[1] == _COMPONENTS[kind]
        view = {"buffer": 0, "byteOffset": self._binary.tell(), "byteLength": values.nbytes}
        if target is not None:
            view["target"] = target
        self._binary.write(values.data)
        accessor: dict[str, Any] = {
            "bufferView": len(self._lists["bufferViews"]),
            "componentType": _UINT32 if is_index else _FLOAT,
            "count": len(values),
            "type": kind,
        }
        if bounds:
            accessor["min"] = values.min(axis=0).tolist()
            accessor["max"] = values.max(axis=0).tolist()
        self._lists["bufferViews"].append(view)
        self._lists["accessors"].append(accessor)
        return len(self._lists["accessors"]) - 1


def _split_at_seams(part: ScenePart) -> tuple[np.ndarray, np.ndarray | None, np.ndarray]:
    """Split vertices at UV seams, since glTF has a single index per corner.

    Returns:
        The mesh vertex (V',) and the texture coordinates (V', 2), or None, of each glTF vertex,
        and the triangles (F, 3) between glTF vertices.
    """
    mesh = part.mesh
    if mesh.uv is None or mesh.uv_faces is None:
        return np.arange(len(mesh.vertices)), None, mesh.triangles
    pairs = np.stack([mesh.triangles, triangulate(mesh.uv_faces)], axis=-1).reshape(-1, 2)
    unique, inverse = np.unique(pairs, axis=0, return_inverse=True)
    # The texture origin of glTF is the upper left corner.
    uv = mesh.uv[unique[:, 1]] * [1, -1] + [0, 1]
    return unique[:, 0], uv, inverse.reshape(-1, 3)


def _material(part: ScenePart) -> dict[str, Any]:
    return {
        "name": part.name,
        "pbrMetallicRoughness": {
            "baseColorFactor": [*part.colour, 1.0],
            "metallicFactor": 0.0,
            "roughnessFactor": 0.8,
        },
        # Cloth is a single sheet that is visible from both sides.
        "doubleSided": True,
    }
