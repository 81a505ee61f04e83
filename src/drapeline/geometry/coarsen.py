"""Coarser surfaces through some of a mesh's vertices."""

import igl
import numpy as np
from scipy.spatial import KDTree


def coarsen_faces(vertices: np.ndarray, faces: np.ndarray, share: float) -> np.ndarray:
    """Triangles of a coarser surface through the same vertices (Garland and Heckbert's quadrics).

    Corners are vertices of the body, so that the coarse surface moves with it.

    Args:
        vertices: (B, 3) metres, the body in the pose where its surface is smoothest: at rest.
        faces: (F, 3) int; not all vertices need a face.
        share: of the triangles that is kept, up to 1.

    Returns:
        (F', 3) int of `vertices`, no triangle with a corner twice; all of `faces` where the surface
        cannot be coarsened, as where its boundary touches itself.
    """
    if share >= 1:
        return faces
    used, packed = np.unique(faces, return_inverse=True)
    packed = packed.reshape(faces.shape).astype(np.int64)
    coarse, triangles, *_ = igl.qslim(
        np.ascontiguousarray(vertices[used], dtype=np.float64), packed, round(share * len(faces))
    )
    if not len(triangles):
        return faces
    corner = used[KDTree(vertices[used]).query(coarse)[1]][triangles]
    distinct = (corner != np.roll(corner, 1, axis=1)).all(axis=1)
    return corner[distinct].astype(faces.dtype)
