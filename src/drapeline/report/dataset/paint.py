"""Bodies and garments of samples as the ray tracer takes them."""

from functools import lru_cache
from pathlib import Path

import numpy as np

from drapeline.dataset.pictures import read_picture
from drapeline.dataset.scene_part import ScenePart
from drapeline.rendering.raytracer import ColouredMesh, Texture
from drapeline.report.colours import fabric_gloss


def paint(part: ScenePart, vertices: np.ndarray, fabric: str | None) -> ColouredMesh:
    """A part of a sample, with its print.

    Args:
        vertices: (V, 3) metres.
        fabric: its name; None for the body.

    Raises:
        DamagedFile: the picture of its print is damaged.
    """
    texture = None
    mesh = part.mesh
    if part.texture is not None and mesh.uv is not None and mesh.uv_faces is not None:
        texture = Texture(_halved(part.texture), mesh.uv, mesh.uv_faces)
    return ColouredMesh(vertices, mesh.faces, part.colour, fabric_gloss(fabric), texture)


@lru_cache(maxsize=16)
def _halved(path: Path) -> np.ndarray:
    """A picture with half as many pixels each way, which are finer than any that show them."""
    picture = read_picture(path)
    height, width = (side // 2 for side in picture.shape[:2])
    blocks = picture[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 3)
    return blocks.mean(axis=(1, 3)).astype(np.uint8)
