"""Decoded garments in motion in given poses, and true garments at rest beside decoded ones."""

import numpy as np

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.geometry.collision import resolve_penetration
from drapeline.geometry.mesh import faces_within
from drapeline.learning_data.moving import MovingGarment
from drapeline.metrics.registered import Truth
from drapeline.models.gcvae.codec import GarmentCodec, decode_codes
from drapeline.models.gcvae.data import BodyTemplate, DynamicGarments, StaticGarments
from drapeline.registration.to_body.dynamic_offsets import points_from_offsets
from drapeline.registration.to_body.topology import TOPOLOGIES, Topology


def static_truth(template: BodyTemplate, garments: StaticGarments) -> Truth:
    """The dataset as evaluation takes it, with the bodies and faces of a model's template."""
    return Truth(
        garments.offsets,
        garments.mask,
        body=lambda row: template.rest_body(garments.cvar(np.array([row]))[0]),
        faces=lambda row: template.faces[TOPOLOGIES[int(garments.topology(np.array([row]))[0])]],
        body_faces=template.faces[TOPOLOGIES[0]],
    )


def decode_points(
    model: GarmentCodec,
    garments: DynamicGarments,
    rows: np.ndarray,
    moving: MovingGarment,
    body: BodyModel,
    z: np.ndarray,
    poses: np.ndarray | None = None,
) -> np.ndarray:
    """Registered points (n, M, 3) of one garment, decoded and posed; root-relative metres.

    Args:
        rows: (n,) frames of the garment `moving`; they give the conditions.
        body: super-resolved, of the wearer's gender.
        z: (n, Z) wrinkle codes.
        poses: (n, 4, 72) rad, of the frames and of three before each; those of the rows if None.
    """
    if poses is None:
        poses = garments.data.poses[rows]
    decoded = decode_codes(model, z, garments.cvar(rows, poses), garments.topology(rows))
    return points_from_offsets(
        moving.registered,
        np.stack([offsets for offsets, _ in decoded]),
        body,
        moving.shape,
        poses[:, 0],
        garments.data.version,
    )


def resolve_points(
    moving: MovingGarment,
    body: BodyModel,
    topology: Topology,
    points: np.ndarray,
    poses: np.ndarray,
) -> np.ndarray:
    """Even out a garment's points (n, M, 3) in poses (n, 72) rad and push them off its wearer."""
    registered = moving.registered
    index = np.cumsum(registered.mask) - 1  # of a covered vertex among the points
    faces = index[faces_within(topology.faces_of(moving.name), registered.mask)]
    return resolve_penetration(
        points, faces, posed_vertices(body, moving.shape, poses)[0], topology.faces
    )


def decode_points_for_display(
    model: GarmentCodec,
    garments: DynamicGarments,
    rows: np.ndarray,
    moving: MovingGarment,
    body: BodyModel,
    topology: Topology,
    z: np.ndarray,
    poses: np.ndarray | None = None,
) -> np.ndarray:
    """Points (n, M, 3) of one garment as pictures show them, out of the body if the model says so.

    See `decode_points`.
    """
    points = decode_points(model, garments, rows, moving, body, z, poses)
    if not model.resolves_penetration:
        return points
    poses = garments.data.poses[rows] if poses is None else poses
    return resolve_points(moving, body, topology, points, poses[:, 0])
