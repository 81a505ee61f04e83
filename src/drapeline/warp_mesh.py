"""Triangle meshes as Warp indexes them, for closest points and rays."""

import numpy as np
import warp as wp

wp.config.log_level = wp.LOG_WARNING


def warp_mesh(vertices: np.ndarray, faces: np.ndarray) -> wp.Mesh:
    """A mesh on the processor.

    Args:
        vertices: (V, 3).
        faces: (F, 3).
    """
    return wp.Mesh(
        points=wp.array(vertices.astype(np.float32, copy=False), dtype=wp.vec3, device="cpu"),
        indices=wp.array(faces.astype(np.int32, copy=False).ravel(), dtype=int, device="cpu"),
    )
