"""Points of a cloud relative to a known body: what lies beneath each of them, and how far below.

F frames, P points. Coordinates are metres relative to the root joint, Z up.
"""

import numpy as np
from scipy.spatial import cKDTree

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.rest_body import rest_body, rest_to_pose
from drapeline.geometry.mesh import vertex_normals

_NEAR_M = 0.005  # cloth that lies on skin is less than this above it


def body_relative_points(
    body: BodyModel, shape: np.ndarray, poses: np.ndarray, points: np.ndarray
) -> np.ndarray:
    """Points with their place on the body at rest, and their height above it.

    Args:
        body: whole, in SMPL's format.
        shape: (10,).
        poses: (F, 72) rad.
        points: (F, P, 3) metres, root frame.

    Returns:
        (F, P, 7) float32: the points; the same points carried back to the rest pose with the
        nearest vertex of the body; and arsinh(h / 5 mm) of the height h above that vertex along
        its normal, which tells skin from tight cloth as well as tight cloth from wide.
    """
    posed = posed_vertices(body, shape, poses)[0]
    motions = joint_transforms(body, shape, poses).reshape(len(poses), -1, 16)  # (F, 24, 16)
    rest_normals = vertex_normals(rest_body(body, shape), body.faces)
    out = np.zeros((*points.shape[:2], 7), dtype=np.float32)
    for frame, cloud in enumerate(points):
        nearest = nearest_vertices(posed[frame], cloud)
        transform = (body.weights[nearest] @ motions[frame]).reshape(-1, 4, 4)
        turn, shift = transform[:, :3, :3], transform[:, :3, 3]
        rest = np.linalg.solve(turn, (cloud - shift)[..., None])[..., 0]
        normals = np.einsum("pij,pj->pi", turn, rest_normals[nearest])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        height = ((cloud - posed[frame, nearest]) * normals).sum(axis=1)
        out[frame] = np.column_stack([cloud, rest, np.arcsinh(height / _NEAR_M)])
    return out


def nearest_vertices(vertices: np.ndarray, cloud: np.ndarray) -> np.ndarray:
    """(P,) which of a body's vertices (B, 3) are nearest to the points (P, 3) of a frame."""
    # A tree that is queried once is not worth balancing.
    return cKDTree(vertices, balanced_tree=False, compact_nodes=False).query(cloud)[1]


def joint_transforms(body: BodyModel, shape: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """(F, 24, 4, 4) float32 motions of body parts from rest to poses (F, 72) rad, of one shape."""
    motions = rest_to_pose(body, shape, poses)
    last = np.broadcast_to(np.array([0.0, 0.0, 0.0, 1.0]), (*motions.shape[:2], 1, 4))
    return np.concatenate([motions, last], axis=2).astype(np.float32)
