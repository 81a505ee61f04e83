"""Point clouds in pictures."""

import numpy as np
from trimesh.creation import icosahedron

from drapeline.dataset.labels import LABELS
from drapeline.dataset.scene_part import BODY_COLOUR
from drapeline.outfits.garment_types import GARMENTS
from drapeline.rendering.raytracer import BACKDROP, ColouredMesh
from drapeline.report.colours import garment_colour
from drapeline.report.models.scene import PICTURE_SIZE, Scene

_SURFACE_M2 = 2.2  # of a dressed body, roughly: what a cloud's points are spread over
_POINT_SHARE = 0.37  # radius of a drawn point, of the distance between them
_DEPTH_LEVELS, _HAZE = 6, 0.6  # distant points are drawn paler, so that near ones stand out


def cloud_parts(points: np.ndarray, labels: np.ndarray, scene: Scene) -> list[ColouredMesh]:
    """Draw a cloud (P, 3) as balls in the colours of its labels (P,), paler in the distance."""
    colours = [BODY_COLOUR if name not in GARMENTS else garment_colour(name) for name in LABELS]
    depth = points @ scene.camera(PICTURE_SIZE).axes[2]
    share = (depth - depth.min()) / max(float(np.ptp(depth)), 1e-9)
    level = np.minimum((share * _DEPTH_LEVELS).astype(int), _DEPTH_LEVELS - 1)
    radius = _POINT_SHARE * np.sqrt(_SURFACE_M2 / len(points))
    parts = []
    for label, far in sorted(set(zip(labels.tolist(), level.tolist(), strict=True))):
        haze = _HAZE * far / (_DEPTH_LEVELS - 1)
        colour = (1 - haze) * np.array(colours[label]) + haze * BACKDROP
        parts.append(
            ColouredMesh(*_balls(points[(labels == label) & (level == far)], radius), colour)
        )
    return parts


def _balls(points: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Icosahedra, which smooth normals make round."""
    ball = icosahedron()
    vertices = np.asarray(points, dtype=np.float64)[:, None] + radius * ball.vertices
    first = len(ball.vertices) * np.arange(len(points))[:, None, None]
    return vertices.reshape(-1, 3), (first + ball.faces).reshape(-1, 3)
