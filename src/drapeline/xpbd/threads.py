"""Directions of the threads in a garment at rest, and vertices that lie along a thread."""

import numpy as np
import scipy.sparse as sp

from drapeline.geometry.least_squares import symmetric_factor
from drapeline.geometry.mesh import edge_lengths, edges, triangulate
from drapeline.geometry.smoothing import uniform_laplacian

# How far around a point the cloth is looked at to tell along from around.
_NEIGHBOURHOOD_M = 0.1
# Where cloth is flat, the warp hangs down; on a table it is along the X axis.
_UPRIGHT, _SIDEWAYS = 0.05, 0.02


def warp_directions(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit vectors (F, 3) along the warp, in the plane of each face.

    The warp runs along a garment or limb: along the axis of the tube that the cloth around a face
    makes, to which normals are orthogonal.

    Args:
        vertices: (V, 3) metres, at rest.
        faces: (F, 4) or (F, 3).
    """
    normals = _scaled_normals(vertices, faces)
    square = np.einsum("fi,fj->fij", normals, normals).reshape(-1, 9)
    square /= np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
    count = len(vertices)
    corner = sp.csr_matrix(
        (np.ones(faces.size), (faces.ravel(), np.repeat(np.arange(len(faces)), faces.shape[1]))),
        shape=(count, len(faces)),
    )
    edge_m = edge_lengths(vertices, edges(faces)).mean()
    spread = (_NEIGHBOURHOOD_M / edge_m) ** 2 * uniform_laplacian(faces, count)
    smooth = symmetric_factor(sp.identity(count) + spread).solve(corner @ square)
    around = (corner.T @ smooth).reshape(-1, 3, 3)
    around /= np.maximum(np.trace(around, axis1=1, axis2=2), 1e-30)[:, None, None]
    around -= np.diag([_SIDEWAYS, 0, _UPRIGHT])
    axis = np.linalg.eigh(around)[1][:, :, 0]
    unit = normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
    within = axis - (axis * unit).sum(1)[:, None] * unit
    return within / np.maximum(np.linalg.norm(within, axis=1), 1e-12)[:, None]


def weft_directions(vertices: np.ndarray, faces: np.ndarray, warp: np.ndarray) -> np.ndarray:
    """Unit vectors (F, 3) across the warp (F, 3), in the plane of each face."""
    normals = _scaled_normals(vertices, faces)
    weft = np.cross(normals, warp)
    return weft / np.maximum(np.linalg.norm(weft, axis=1), 1e-12)[:, None]


def _scaled_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Normals (F, 3) as long as twice the area of each face."""
    a, b, c = np.moveaxis(vertices[triangulate(faces)], 1, 0)
    return np.cross(b - a, c - a).reshape(len(faces), -1, 3).sum(axis=1)
