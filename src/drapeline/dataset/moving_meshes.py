"""Garments and bodies in motion from whatever files they come in."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from drapeline.dataset.animated_gltf import read_gltf
from drapeline.dataset.reader import Sample
from drapeline.dataset.sample_meshes import scene_parts
from drapeline.dataset.scene_part import PLAIN_COLOUR, ScenePart
from drapeline.errors import InputError
from drapeline.frames import FPS
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.obj import load_obj
from drapeline.geometry.point_cache import PointCache
from drapeline.outfits.garment_types import BODY
from drapeline.storage import load_npz

_CACHES = (".pc2", ".mdd", ".pc16")
_SIZE_M = (0.1, 50.0)  # of people and their clothes, wherever they go
_KINDS = (
    "a sample's folder, .glb or .gltf, a folder of OBJ files, .pc2 or .mdd beside an OBJ of the"
    " same name, or .npz"
)


def read_moving_meshes(path: str | Path, opened: ExitStack, *, fps: float = FPS) -> list[ScenePart]:
    """Read meshes in motion: each with the same vertices and faces in all frames.

    - a sample in CLOTH3D's format: body and garments, in the world;
    - `.glb`, `.gltf`: see `read_gltf`;
    - a folder with an OBJ for each frame, in the order of their names; or with one such folder for
      each mesh, as drapeline's own export has them;
    - `.pc2`, `.mdd`, `.pc16`: of the mesh in the OBJ of the same name beside it;
    - `.npz`: `vertices` (F, V, 3) and `faces`, and perhaps `body_vertices` and `body_faces`.

    Args:
        path: file or folder; it gives a mesh its name.
        opened: closes files that are read as they are needed.
        fps: frames per second to read glTF at.

    Raises:
        InputError: it is nothing of this, is damaged, or is not in metres.
    """
    path = Path(path)
    parts = _read(path, opened, fps)
    size = max(float(np.ptp(part.mesh.vertices, axis=0).max()) for part in parts)
    if not _SIZE_M[0] < size < _SIZE_M[1]:
        raise InputError(
            f"{path}: the largest mesh is {size:.4g} m long, expected metres and people of"
            " a metre or two"
        )
    return parts


def _read(path: Path, opened: ExitStack, fps: float) -> list[ScenePart]:
    suffix = path.suffix.lower()
    if (path / "info.mat").is_file():
        return scene_parts(opened.enter_context(Sample(path)))
    if path.is_dir():
        return _read_folder(path, opened)
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected {_KINDS}")
    if suffix in (".glb", ".gltf"):
        return read_gltf(path, fps)
    if suffix in _CACHES:
        return [_read_cache(path, opened)]
    if suffix == ".npz":
        return _read_arrays(path)
    raise InputError(f"{path}: '{path.suffix}' is unknown, expected {_KINDS}")


def _read_folder(path: Path, opened: ExitStack) -> list[ScenePart]:
    if caches := sorted(file for file in path.iterdir() if file.suffix.lower() in _CACHES):
        return [_read_cache(file, opened) for file in caches]
    if frames := _objs(path):
        return [_read_sequence(path.name, frames)]
    folders = {folder: _objs(folder) for folder in sorted(path.iterdir()) if folder.is_dir()}
    parts = [_read_sequence(folder.name, frames) for folder, frames in folders.items() if frames]
    if not parts:
        raise InputError(f"{path}: has neither OBJ files nor caches, expected {_KINDS}")
    return parts


def _objs(folder: Path) -> list[Path]:
    files = (file for file in folder.iterdir() if file.suffix.lower() == ".obj")
    return sorted(file for file in files if not file.name.startswith("."))


def _read_sequence(name: str, files: Sequence[Path]) -> ScenePart:
    meshes = [load_obj(file) for file in files]
    for file, mesh in zip(files, meshes, strict=True):
        if not np.array_equal(mesh.faces, meshes[0].faces):
            raise InputError(f"{file}: has other faces than {files[0].name}, expected the same")
    return _part(name, meshes[0], np.stack([mesh.vertices for mesh in meshes]))


def _read_cache(path: Path, opened: ExitStack) -> ScenePart:
    beside = path.with_suffix(".obj")
    if not beside.is_file():
        raise InputError(f"{path}: lacks {beside.name} beside it, expected the mesh that it moves")
    mesh = load_obj(beside)
    cache = opened.enter_context(PointCache(path, len(mesh.vertices)))
    if cache.vertex_count != len(mesh.vertices):
        raise InputError(
            f"{path}: {cache.vertex_count} vertices, expected the {len(mesh.vertices)} of"
            f" {beside.name}"
        )
    return ScenePart(path.stem, mesh, PLAIN_COLOUR, cache.frames, len(cache))


def _read_arrays(path: Path) -> list[ScenePart]:
    forms = {
        "vertices": "float frames v 3",
        "faces": "int<v f k",
        "body_vertices?": "float frames b 3",
        "body_faces?": "int<b g m",
    }
    arrays = load_npz(path, forms)
    parts = [_moving(path, path.stem, arrays["vertices"], arrays["faces"])]
    if "body_vertices" in arrays:
        if "body_faces" not in arrays:
            raise InputError(f"{path}: has body_vertices but no body_faces, expected both")
        parts.append(_moving(path, BODY, arrays["body_vertices"], arrays["body_faces"]))
    return parts


def _moving(path: Path, name: str, vertices: np.ndarray, faces: np.ndarray) -> ScenePart:
    if not len(vertices) or not len(faces) or faces.shape[1] not in (3, 4):
        raise InputError(
            f"{path}: {name} has vertices {vertices.shape} and faces {faces.shape}, expected frames"
            " (F, V, 3), and triangles or quads"
        )
    points = np.asarray(vertices, dtype=np.float32)
    return _part(name, Mesh(points[0], np.asarray(faces, dtype=np.int32)), points)


def _part(name: str, mesh: Mesh, points: np.ndarray) -> ScenePart:
    read: Callable[[int, int], np.ndarray] = lambda start, stop: points[start:stop]  # noqa: E731
    return ScenePart(name, mesh, PLAIN_COLOUR, read, len(points))
