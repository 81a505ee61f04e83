"""Moving meshes as OBJ files and caches of points, Y up, as importers of these expect."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drapeline.dataset.scene_part import ScenePart, to_y_up
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.obj import save_obj
from drapeline.geometry.point_cache import point_cache_writer


def write_caches(folder: str | Path, parts: Sequence[ScenePart], suffix: str) -> None:
    """Write, for each part, `{name}.obj` at rest and a cache of its frames: ".pc2" or ".mdd"."""
    for part in parts:
        save_obj(Path(folder, f"{part.name}.obj"), _mesh(part, part.mesh.vertices))
        with point_cache_writer(
            Path(folder, f"{part.name}{suffix}"),
            len(part.mesh.vertices),
            frame_count=part.frame_count,
        ) as cache:
            for points in part.frames():
                cache.append(to_y_up(points))


def write_obj_sequence(folder: str | Path, parts: Sequence[ScenePart]) -> None:
    """Write, for each part, a folder of its name with `{name}_{frame:04d}.obj` for each frame."""
    for part in parts:
        for frame, points in enumerate(part.frames()):
            save_obj(Path(folder, part.name, f"{part.name}_{frame:04d}.obj"), _mesh(part, points))


def _mesh(part: ScenePart, points: np.ndarray) -> Mesh:
    return Mesh(to_y_up(points), part.mesh.faces, part.mesh.uv, part.mesh.uv_faces)
