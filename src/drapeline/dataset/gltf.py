"""Write animated meshes to a binary glTF 2.0 file: bones for bodies, morph targets for cloth.

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
from scipy.spatial.transform import Rotation

from drapeline import __version__
from drapeline.bodies.kinematics import joint_transforms, skin_points, unskin_points
from drapeline.dataset.scene_part import ScenePart, Skin, to_y_up
from drapeline.frames import FPS, JOINT_NAMES, PARENTS
from drapeline.geometry.mesh import split_at_seams, triangulate, vertex_normals
from drapeline.storage import atomic_file

_LISTS = ("nodes", "meshes", "materials", "textures", "images", "skins")
_COMPONENT_TYPES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
_VERTEX_DATA, _INDEX_DATA = 34962, 34963
_KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
_INFLUENCES = 4  # bones per vertex that every viewer takes
_OFF_M = 1e-3  # from where bones leave a vertex to where it is, without a target of its own
_Y_UP = (-(0.5**0.5), 0.0, 0.0, 0.5**0.5)  # the quaternion of `to_y_up`
_QUANTISATION = "KHR_mesh_quantization"

_Split = tuple[np.ndarray, np.ndarray | None, np.ndarray]


def write_glb(path: str | Path, parts: Sequence[ScenePart]) -> None:
    """Write parts, Y up and in metres, with normals, texture coordinates and plain colours.

    Prints are textures within the file.

    Frame 0 is the base mesh, in single precision. Each later frame is a morph target that is fully
    on at its own time and off at the times of the other frames, interpolated linearly. What the
    first part moves as a whole is left to a node above all parts. Targets are integers, as the
    extension `KHR_mesh_quantization` allows: 16 bits per number of positions and 8 of normals. They
    are divided by their largest number, which is the weight that turns them on. So positions are
    exact to 0.04 mm unless a vertex moves by more than 2.5 m beside the first part. A single frame
    is a still without targets. Memory use does not grow with the number of frames.

    A part with a skin in motion is moved by bones instead, four for each vertex as viewers take
    them, and by sparse morph targets for vertices that these leave more than a millimetre off.

    Args:
        path: the `.glb` file.
        parts: parts of one sample, all with the same number of frames.
    """
    with tempfile.TemporaryFile() as binary:
        asset = _Asset(binary, _path(parts[0]))
        for part in parts:
            asset.add_part(part)
        document = json.dumps(asset.finish(), separators=(",", ":")).encode()
        document += b" " * (-len(document) % 4)
        binary.write(b"\0" * (-binary.tell() % 4))
        length = binary.tell()
        binary.seek(0)
        with atomic_file(path) as scratch, open(scratch, "wb") as stream:
            stream.write(struct.pack("<4sII", b"glTF", 2, 28 + len(document) + length))
            stream.write(struct.pack("<I4s", len(document), b"JSON") + document)
            stream.write(struct.pack("<I4s", length, b"BIN\0"))
            shutil.copyfileobj(binary, stream, 1 << 20)


class _Asset:
    """The JSON of a glTF file, built up along with the binary data that it describes."""

    def __init__(self, binary: BinaryIO, path: np.ndarray) -> None:
        self._binary = binary
        self._path = path
        self._lists: dict[str, list[dict[str, Any]]] = {
            name: [] for name in (*_LISTS, "accessors", "bufferViews")
        }
        self._moved: list[int] = []  # nodes beneath the one that moves as the first part does
        self._roots: list[int] = []
        self._samplers: list[dict[str, Any]] = []
        self._channels: list[dict[str, Any]] = []
        if len(path) > 1:
            times = np.arange(len(path), dtype="<f4")[:, None] / FPS
            self._times = self._add(times, None, bounds=True)

    def finish(self) -> dict[str, Any]:
        roots = [*self._roots, *self._moved]
        if self._samplers:
            node = self._add_node({"name": "sample", "children": self._moved})
            self._animate(node, "translation", self._path)
            roots = [*self._roots, node]
        document = {
            "asset": {"version": "2.0", "generator": f"drapeline {__version__}"},
            "scene": 0,
            "scenes": [{"nodes": roots}],
            **{name: things for name, things in self._lists.items() if things},
            "buffers": [{"byteLength": self._binary.tell()}],
        }
        if self._samplers:
            document["extensionsUsed"] = document["extensionsRequired"] = [_QUANTISATION]
            document["animations"] = [
                {"name": "sequence", "samplers": self._samplers, "channels": self._channels}
            ]
        return document

    def add_part(self, part: ScenePart) -> None:
        if part.frame_count > 1 and (skin := part.read_skin()) is not None:
            self._add_skinned(part, skin)
            return
        split = _split(part)
        source = split[0]
        faces = triangulate(part.mesh.faces)
        frames = part.frames()
        base = _points_and_normals(next(frames), faces)
        targets, weights = [], []
        for points, shift in zip(frames, self._path[1:], strict=True):
            points, normals = _points_and_normals(points, faces)
            moved, turned = points - shift - base[0], normals - base[1]
            weights.append(max(np.abs(moved).max(), np.abs(turned).max()) or 1.0)
            targets.append(
                {
                    "POSITION": self._add_quantised(moved[source] / weights[-1], "<i2"),
                    "NORMAL": self._add_quantised(turned[source] / weights[-1], "<i1"),
                }
            )
        on = np.diag([0.0, *weights])[:, 1:]
        self._moved.append(self._add_mesh(part, split, *base, targets, on))

    def _add_skinned(self, part: ScenePart, skin: Skin) -> None:
        split = _split(part)
        source = split[0]
        most = np.argsort(-skin.weights, axis=1, kind="stable")[:, :_INFLUENCES]
        weights = np.take_along_axis(skin.weights, most, axis=1)
        weights /= weights.sum(axis=1, keepdims=True)
        all_weights = np.zeros_like(skin.weights)
        np.put_along_axis(all_weights, most, weights, axis=1)
        targets = []
        for frame, points in enumerate(part.frames()):
            motions, _ = joint_transforms(skin.joints, skin.rotations[frame, None])
            there = (points - skin.path[frame])[None].astype(np.float64)
            off = unskin_points(there, motions, all_weights)[0] - skin.rest
            left = np.linalg.norm(
                there[0] - skin_points(skin.rest, motions, all_weights)[0], axis=1
            )
            off[(left < _OFF_M) & (left < left.max())] = 0  # there has to be one
            targets.append({"POSITION": self._add_sparse(off[source])})
        normals = vertex_normals(skin.rest, triangulate(part.mesh.faces))
        node = self._add_mesh(part, split, skin.rest, normals, targets, np.eye(len(targets)))
        self._lists["nodes"][node]["skin"] = len(self._lists["skins"])
        attributes = self._lists["meshes"][-1]["primitives"][0]["attributes"]
        attributes["JOINTS_0"] = self._add(most[source].astype("u1"), _VERTEX_DATA)
        attributes["WEIGHTS_0"] = self._add(weights[source].astype("<f4"), _VERTEX_DATA)
        self._roots += [node, self._add_skeleton(part.name, skin)]

    def _add_skeleton(self, name: str, skin: Skin) -> int:
        """Add the skin, and its bones in motion, beneath a node that turns Z up to Y up."""
        first = len(self._lists["nodes"])
        turns = Rotation.from_matrix(skin.rotations.reshape(-1, 3, 3)).as_quat().reshape(-1, 24, 4)
        for joint, parent in enumerate(PARENTS):
            children = [first + int(child) for child in np.flatnonzero(joint == PARENTS)]
            place = skin.path[0] if joint == 0 else skin.joints[joint] - skin.joints[parent]
            about = {
                "name": JOINT_NAMES[joint],
                "translation": np.asarray(place, np.float64).tolist(),
                "rotation": turns[0, joint].tolist(),
            }
            node = self._add_node(about | ({"children": children} if children else {}))
            self._animate(node, "rotation", _unbroken(turns[:, joint]))
        self._animate(first, "translation", skin.path)
        binds = np.tile(np.eye(4), (24, 1, 1))
        binds[:, 3, :3] = -skin.joints  # columns first
        self._lists["skins"].append(
            {
                "name": f"{name}_skeleton",
                "joints": list(range(first, first + 24)),
                "skeleton": first,
                "inverseBindMatrices": self._add(binds.reshape(24, 16).astype("<f4"), None),
            }
        )
        return self._add_node({"name": f"{name}_skeleton", "rotation": _Y_UP, "children": [first]})

    def _add_node(self, about: dict[str, Any]) -> int:
        self._lists["nodes"].append(about)
        return len(self._lists["nodes"]) - 1

    def _add_mesh(
        self,
        part: ScenePart,
        split: _Split,
        points: np.ndarray,
        normals: np.ndarray,
        targets: list[dict[str, int]],
        on: np.ndarray,
    ) -> int:
        """Add a mesh with points and normals (V, 3), and return the number of its node.

        `on` (F, T) is how far on each target is in each frame.
        """
        source, uv, triangles = split
        attributes = {
            "POSITION": self._add(points[source].astype("<f4"), _VERTEX_DATA, bounds=True),
            "NORMAL": self._add(normals[source].astype("<f4"), _VERTEX_DATA),
        }
        if uv is not None:
            attributes["TEXCOORD_0"] = self._add(uv.astype("<f4"), _VERTEX_DATA)
        index_type = "<u2" if len(source) < 0xFFFF else "<u4"
        primitive: dict[str, Any] = {
            "attributes": attributes,
            "indices": self._add(triangles.reshape(-1, 1).astype(index_type), _INDEX_DATA),
            "material": len(self._lists["materials"]),
        }
        mesh: dict[str, Any] = {"name": part.name, "primitives": [primitive]}
        node = self._add_node({"name": part.name, "mesh": len(self._lists["meshes"])})
        if targets:
            primitive["targets"] = targets
            mesh["weights"] = on[0].tolist()
            numbers = range(len(on) - len(targets), len(on))
            mesh["extras"] = {"targetNames": [f"{f:04d}" for f in numbers]}
            self._animate(node, "weights", on.reshape(-1, 1))
        self._lists["materials"].append(self._material(part))
        self._lists["meshes"].append(mesh)
        return node

    def _material(self, part: ScenePart) -> dict[str, Any]:
        surface: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 0.8}
        if part.texture is None or part.mesh.uv is None:
            surface["baseColorFactor"] = [*part.linear_colour, 1.0]
        else:
            surface["baseColorTexture"] = {"index": len(self._lists["textures"])}
            self._lists["textures"].append({"source": len(self._lists["images"])})
            picture = {"mimeType": "image/png", "bufferView": len(self._lists["bufferViews"])}
            self._lists["images"].append({"name": part.name, **picture})
            self._add_bytes(part.texture.read_bytes())
        # Cloth is a single sheet that is visible from both sides.
        return {"name": part.name, "pbrMetallicRoughness": surface, "doubleSided": True}

    def _add_bytes(self, data: bytes) -> None:
        """Append bytes to the binary, with a buffer view of their own."""
        self._binary.write(b"\0" * (-self._binary.tell() % 4))
        view = {"buffer": 0, "byteOffset": self._binary.tell(), "byteLength": len(data)}
        self._lists["bufferViews"].append(view)
        self._binary.write(data)

    def _animate(self, node: int, path: str, values: np.ndarray) -> None:
        """Animate a property of a node, interpolated linearly between frames."""
        output = self._add(values.astype("<f4"), None)
        self._samplers.append({"input": self._times, "output": output, "interpolation": "LINEAR"})
        self._channels.append(
            {"sampler": len(self._samplers) - 1, "target": {"node": node, "path": path}}
        )

    def _add_sparse(self, values: np.ndarray) -> int:
        """Append the vectors (n, 3) that are not zero, and say which they are."""
        which = np.flatnonzero(values.any(axis=1))
        places = self._add(which[:, None].astype("<u4"), None)
        there = self._add(values[which].astype("<f4"), None)
        accessors = self._lists["accessors"]
        indices, numbers = accessors.pop(places), accessors.pop(places)
        assert there == places + 1
        accessors.append(
            {
                "componentType": numbers["componentType"],
                "count": len(values),
                "type": numbers["type"],
                "min": np.minimum(values.min(axis=0), 0).astype("<f4").tolist(),
                "max": np.maximum(values.max(axis=0), 0).astype("<f4").tolist(),
                "sparse": {
                    "count": len(which),
                    "indices": {key: indices[key] for key in ("bufferView", "componentType")},
                    "values": {"bufferView": numbers["bufferView"]},
                },
            }
        )
        return places

    def _add_quantised(self, values: np.ndarray, dtype: str) -> int:
        """Append vectors (n, 3) of numbers from -1 to 1 as normalised signed integers."""
        peak = np.iinfo(dtype).max
        # glTF wants vertices to begin at multiples of four bytes, so a fourth number fills them up.
        padded = np.zeros((len(values), 4), dtype)
        padded[:, :3] = np.round(values * peak)
        return self._add(padded, _VERTEX_DATA, components=3, bounds=dtype == "<i2")

    def _add(
        self,
        values: np.ndarray,
        target: int | None,
        *,
        components: int | None = None,
        bounds: bool = False,
    ) -> int:
        """Append an array (n, components) to the binary and return its accessor's index.

        Rows are those of an accessor of as many components, or of fewer with the rest as padding.
        """
        components = components or values.shape[1]
        self._binary.write(b"\0" * (-self._binary.tell() % 4))
        view = {"buffer": 0, "byteOffset": self._binary.tell(), "byteLength": values.nbytes}
        if target is not None:
            view["target"] = target
        self._binary.write(np.ascontiguousarray(values).data)
        accessor: dict[str, Any] = {
            "bufferView": len(self._lists["bufferViews"]),
            "componentType": _COMPONENT_TYPES[values.dtype.str[1:]],
            "count": len(values),
            "type": _KINDS[components],
        }
        if components < values.shape[1]:
            view["byteStride"] = values.strides[0]
            accessor["normalized"] = True
        if bounds:
            accessor["min"] = values[:, :components].min(axis=0).tolist()
            accessor["max"] = values[:, :components].max(axis=0).tolist()
        self._lists["bufferViews"].append(view)
        self._lists["accessors"].append(accessor)
        return len(self._lists["accessors"]) - 1


def _points_and_normals(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and their normals (V, 3), Y up, in single precision."""
    normals = vertex_normals(points, faces)
    return to_y_up(points).astype("<f4"), to_y_up(normals).astype("<f4")


def _path(part: ScenePart) -> np.ndarray:
    """Displacement (F, 3) of the centre of a part's bounding box since frame 0, Y up."""
    centres = [(points.min(axis=0) + points.max(axis=0)) / 2 for points in part.frames()]
    return to_y_up(np.stack(centres) - centres[0])


def _unbroken(quaternions: np.ndarray) -> np.ndarray:
    """Quaternions (F, 4) of the same rotations, each on the side of the one before."""
    turned = (quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0
    signs = np.cumprod(np.where([False, *turned], -1.0, 1.0))
    return quaternions * signs[:, None]


def _split(part: ScenePart) -> _Split:
    """As `split_at_seams`, with texture coordinates as glTF has them."""
    source, uv, triangles = split_at_seams(part.mesh)
    # Its origin is the upper left corner.
    return source, None if uv is None else uv * [1, -1] + [0, 1], triangles
