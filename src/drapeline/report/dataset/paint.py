"""Bodies and garments of samples as the ray tracer takes them."""

import numpy as np

from drapeline.dataset.pictures import halved_picture
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
        texture = Texture(halved_picture(part.texture), mesh.uv, mesh.uv_faces)
    return ColouredMesh(vertices, mesh.faces, part.colour, fabric_gloss(fabric), texture)
