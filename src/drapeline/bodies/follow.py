"""Points of the space around a body that follow it from the rest pose into another, and back.

They keep their places relative to the closest vertices of the body. P points, V vertices of it.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.spatial import KDTree

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.rest_body import rest_body, rest_to_pose
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.rotations import nearest_rotations
from drapeline.geometry.smoothing import averaging_matrix, blur

_SMALL_M = 1e-3  # keeps a single vertex from outweighing all others
_PATCH = 16  # vertices of cloth that tell how it turns
_LEAF = 32  # vertices in a tree's leaf; several closest ones are found a third faster than with 10


class PosedBody(NamedTuple):
    """A body at rest and in another pose."""

    rest: np.ndarray  # (V, 3) metres, in `drapeline.frames.REST_POSE`, root joint at the origin
    posed: np.ndarray  # (V, 3) metres, in the world
    turns: np.ndarray  # (V, 3, 3) linear part of each vertex's motion from the one to the other
    faces: np.ndarray  # (F, 3)


def pose_body(body: BodyModel, shape: np.ndarray, pose: np.ndarray, trans: np.ndarray) -> PosedBody:
    """A body at rest and in a pose.

    Args:
        shape: (10,).
        pose: (72,) axis-angle, rad; its root rotation leads to the world.
        trans: (3,) the root joint there, metres.
    """
    posed, _ = posed_vertices(body, shape, pose[None], trans[None])
    motions = rest_to_pose(body, shape, pose[None])[0]
    turns = (body.weights @ motions[..., :3].reshape(-1, 9)).reshape(-1, 3, 3)
    return PosedBody(rest_body(body, shape), posed[0].astype(np.float64), turns, body.faces)


def add_cloth(body: PosedBody, rest: np.ndarray, posed: np.ndarray) -> PosedBody:
    """The body and cloth on it, so that points near the cloth follow it.

    Args:
        body: the wearer; its faces stay the only ones.
        rest, posed: (C, 3) vertices of the cloth at rest and in the pose, metres.

    Returns:
        Vertices of the body, then of the cloth, each of which turns as those around it do.
    """
    near = KDTree(rest).query(rest, k=min(_PATCH, len(rest)))[1].reshape(len(rest), -1)
    before, after = (
        patch - patch.mean(axis=1, keepdims=True)
        for patch in (rest[near].astype(np.float64), posed[near].astype(np.float64))
    )
    turns = nearest_rotations(after.transpose(0, 2, 1) @ before)
    return PosedBody(
        np.concatenate([body.rest, rest]),
        np.concatenate([body.posed, posed]),
        np.concatenate([body.turns, turns]),
        body.faces,
    )


def near_vertices(
    points: np.ndarray, vertices: np.ndarray, neighbours: int
) -> tuple[np.ndarray, np.ndarray]:
    """The closest vertices (P, K) of points (P, 3), and how much each counts (P, K).

    That is by the inverse square of its distance; the shares of a point sum to 1.
    """
    distance, near = KDTree(vertices, leafsize=_LEAF).query(points, k=neighbours)
    shape = (len(points), neighbours)
    share = 1 / np.maximum(distance.reshape(shape), _SMALL_M) ** 2
    return near.reshape(shape), share / share.sum(axis=1, keepdims=True)


def point_motions(points: np.ndarray, body: PosedBody, neighbours: int) -> np.ndarray:
    """(P, 4, 3) affine motions of points at rest into the pose: shift, then the linear part's rows.

    A point keeps its place relative to the closest vertices of the body, see `near_vertices`; with
    one neighbour this is SMPLicit's motion.
    """
    near, share = near_vertices(points, body.rest, neighbours)
    rows = np.arange(len(points) + 1) * neighbours
    blend = sp.csr_matrix((share.ravel(), near.ravel(), rows), shape=(len(points), len(body.rest)))
    shift = body.posed - np.einsum("vab,vb->va", body.turns, body.rest)
    motion = np.concatenate([shift, body.turns.reshape(-1, 9)], axis=1)
    return (blend @ motion).reshape(-1, 4, 3)


def move(points: np.ndarray, motions: np.ndarray) -> np.ndarray:
    """(P, 3) points after the motions (P, 4, 3) of `point_motions`."""
    return motions[:, 0] + np.einsum("pab,pb->pa", motions[:, 1:], points)


class PlacesAtRest(NamedTuple):
    """Points of the posed body's space, moved back to rest."""

    places: np.ndarray  # (P, 3) metres, at rest
    near: np.ndarray  # (P, K) vertices that each point follows, the closest ones in the pose
    share: np.ndarray  # (P, K) how much each of them counts
    back: np.ndarray  # (P, K, 3, 3) linear parts of their motions back
    offsets: np.ndarray  # (P, K, 3) of the point from each of them, at rest


def move_to_rest(points: np.ndarray, body: PosedBody, neighbours: int) -> PlacesAtRest:
    """Points (P, 3) around a posed body, moved back to rest by its K closest vertices.

    With one neighbour this is SMPLicit's motion (4.2).
    """
    near, share = near_vertices(points, body.posed, neighbours)
    back = np.linalg.inv(body.turns[near])
    offsets = np.einsum("pkab,pkb->pka", back, points[:, None] - body.posed[near])
    places = np.einsum("pk,pka->pa", share, body.rest[near] + offsets)
    return PlacesAtRest(places, near, share, back, offsets)


def garment_motions(
    garment: Mesh, body: PosedBody, *, neighbours: int, smoothing: int
) -> np.ndarray:
    """(V, 4, 3) motions of a garment's vertices into the pose; see `pose_garment` and `move`."""
    motions = point_motions(garment.vertices, body, neighbours)
    average = averaging_matrix(garment.faces, len(garment.vertices))
    return blur(motions.reshape(-1, 12), average, smoothing).reshape(-1, 4, 3)


def pose_garment(garment: Mesh, body: PosedBody, *, neighbours: int, smoothing: int) -> Mesh:
    """A garment at rest, moved into the pose of its wearer.

    Args:
        garment: triangles, on `body.rest`.
        neighbours: vertices of the body that a vertex follows; 1 in SMPLicit's paper.
        smoothing: passes that smooth the motions over the garment, which otherwise jump from one
            leg to the other; none in the paper.
    """
    motions = garment_motions(garment, body, neighbours=neighbours, smoothing=smoothing)
    return Mesh(move(garment.vertices, motions).astype(np.float32), garment.faces)
