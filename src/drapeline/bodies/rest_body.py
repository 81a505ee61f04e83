"""The body that garments are made on: a shape in rest pose, and the tightness that changes it."""

import numpy as np

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.frames import REST_POSE


def rest_body(body: BodyModel, shape: np.ndarray) -> np.ndarray:
    """Vertices (V, 3) float64 of a shape in rest pose, root-relative, Z up."""
    vertices, _ = posed_vertices(body, shape, REST_POSE[None].copy())
    return vertices[0].astype(np.float64)


def tightness_shape(shape: np.ndarray, tightness: np.ndarray, gender: str) -> np.ndarray:
    """Shape a garment is made for (CLOTH3D 3.2): two offsets, the first with the gender's sign.

    Args:
        shape: (10,) the wearer's.
        tightness: (2,) gamma; positive is tighter.
    """
    signed = signed_tightness(tightness, gender)
    target = np.array(shape, dtype=np.float64)
    target[:2] += signed
    return target


def signed_tightness(tightness: np.ndarray, gender: str) -> np.ndarray:
    """(2,) gamma with the sign (-1)^(g + 1) on the first term, g = 0 female, 1 male."""
    return np.asarray(tightness, dtype=np.float64) * [-1.0 if gender == "female" else 1.0, 1.0]
