"""Triangle meshes indexed by Warp, for closest points and rays."""

import os
import sys
import tempfile
from functools import cache

import numpy as np
import warp as wp

from drapeline.rule_log import LOGGER

wp.config.log_level = wp.LOG_WARNING
_NO_DRIVER = b"Could not find or load the NVIDIA CUDA driver"


@cache
def start_warp() -> None:
    """Start Warp, once.

    Where there is no CUDA driver Warp's native part says so on the process's stderr, past Python.
    That is so on most machines, and would show on the terminal for every job: it goes to the log.
    """
    sys.stderr.flush()
    terminal = os.dup(2)
    with tempfile.TemporaryFile() as heard:
        os.dup2(heard.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(terminal, 2)
            os.close(terminal)
            heard.seek(0)
            for line in heard:
                if _NO_DRIVER in line:
                    LOGGER.debug("%s", line.decode().strip())
                else:
                    os.write(2, line)


def warp_mesh(vertices: np.ndarray, faces: np.ndarray) -> wp.Mesh:
    """A mesh, (V, 3) and (F, 3), in main memory, indexed for queries."""
    start_warp()
    fast = {}
    # Built in two fifths of the time of the default one, and as fast to ask; but not every build of
    # Warp has it, and it ends the process where a whole coordinate is NaN.
    if wp.is_cubql_available() and np.isfinite(vertices).all():
        fast = {"bvh_constructor": "cubql", "bvh_leaf_size": 4}
    return wp.Mesh(
        points=wp.array(vertices.astype(np.float32, copy=False), dtype=wp.vec3, device="cpu"),
        indices=wp.array(faces.astype(np.int32, copy=False).ravel(), dtype=int, device="cpu"),
        **fast,
    )


def move_mesh(mesh: wp.Mesh, vertices: np.ndarray) -> None:
    """Take a mesh to other vertices (V, 3); its index keeps its tree, and has new boxes."""
    mesh.points.assign(vertices.astype(np.float32, copy=False))
    mesh.refit()
