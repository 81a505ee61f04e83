"""Garments at rest carried through poses by the wearer's skinning (SMPLicit 3.5), as clips.

They go by way of the T-pose, which takes a body's vertices along exactly. Blending the joints'
motions from the rest pose itself would be off by millimetres to a centimetre where several joints
have a part. The root joint is at the origin everywhere.

What poses do to cloth beside that, P(p, theta, z_theta) there, is left out: a network for it was
measured to give no more than a ridge regression, see docs/background/smplicit.md.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from drapeline.bodies.kinematics import (
    axis_angle_to_matrix,
    joint_transforms,
    skin_points,
    unskin_points,
)
from drapeline.bodies.model import BodyModel, posed_vertices, shape_body
from drapeline.bodies.rest_body import rest_body
from drapeline.bodies.sequence import BodySequence, body_sequence_vertices
from drapeline.bodies.weight_transfer import interpolated_weights
from drapeline.dataset.gltf import write_glb
from drapeline.dataset.scene_part import BODY_COLOUR, PLAIN_COLOUR, ScenePart
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.geometry.collision import PenetrationResolver
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.smoothing import averaging_matrix
from drapeline.metrics.predictions import WornGarment

SKINNINGS = ("nearest", "smoothed")


def garment_weights(
    garment: Mesh, body: BodyModel, shape: np.ndarray, skinning: str = "nearest"
) -> np.ndarray:
    """Skinning weights (V, 24) of a garment at rest, rows sum to 1.

    Args:
        garment: in the rest pose, the root joint at the origin, metres.
        shape: (10,) of the wearer.
        skinning: "nearest", each vertex moves with the body's nearest vertex, as in the paper; or
            "smoothed", with many around it, smoothed over the cloth, so that a skirt does not tear
            between the legs.

    Raises:
        InputError: there is no such skinning.
    """
    if skinning not in SKINNINGS:
        raise InputError(f"skinning: '{skinning}', expected one of {', '.join(SKINNINGS)}")
    at_rest = rest_body(body, shape)
    if skinning == "smoothed":
        return interpolated_weights(garment.vertices, garment.faces, at_rest, body.weights)
    _, nearest = cKDTree(at_rest).query(garment.vertices)
    return body.weights[nearest]


def repose(
    garment: Mesh,
    body: BodyModel,
    shape: np.ndarray,
    poses: np.ndarray,
    *,
    skinning: str = "nearest",
    push_out: bool = False,
) -> np.ndarray:
    """A garment at rest in other poses; pose blend shapes of the body do not move it.

    Args:
        garment: triangles in the rest pose, the root joint at the origin, metres.
        shape: (10,) of the wearer.
        poses: (N, 72) axis-angle, rad.
        skinning: see `garment_weights`.
        push_out: whether vertices inside the posed body are moved out of it.

    Returns:
        (N, V, 3) float32 metres, the root joint at the origin.

    Raises:
        InputError: there is no such skinning, or poses are not (N, 72).
    """
    poses = np.asarray(poses, dtype=np.float64)
    if poses.ndim != 2 or poses.shape[1] != 72:
        raise InputError(f"poses: shape {poses.shape}, expected (frames, 72)")
    weights = garment_weights(garment, body, shape, skinning)
    straight = straighten(garment.vertices, weights, body, shape)
    motions = tpose_motions(body, shape, poses)
    moved = skin_points(straight, motions, weights).astype(np.float32)
    if not push_out or not len(poses):
        return moved
    average = averaging_matrix(garment.faces, len(garment.vertices))
    bodies, _ = posed_vertices(body, shape, poses)
    resolver = PenetrationResolver(bodies[0], body.faces)
    for frame, points in enumerate(bodies):
        resolver.move(points)
        moved[frame] = resolver.push_out(moved[frame], average)
    return moved


def tpose_motions(body: BodyModel, shape: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Motions of the joints' frames from the T-pose, for `skin_points` and `unskin_points`.

    Args:
        shape: (10,) of the wearer.
        poses: (N, 72) axis-angle, rad.

    Returns:
        (N, 24, 3, 4) float64 rotation and translation in metres.
    """
    _, joints = shape_body(body, shape)
    rotations = axis_angle_to_matrix(np.asarray(poses, dtype=np.float64).reshape(-1, 24, 3))
    motions, _ = joint_transforms((joints - joints[0]).astype(np.float64), rotations)
    return motions


def straighten(
    points: np.ndarray, weights: np.ndarray, body: BodyModel, shape: np.ndarray
) -> np.ndarray:
    """(V, 3) float64 points in the T-pose, from points (V, 3) at rest with weights (V, 24)."""
    return unskin_points(points[None], tpose_motions(body, shape, REST_POSE[None]), weights)[0]


def worn_clip(
    garment: Mesh,
    garment_type: str,
    body: BodyModel,
    record: BodySequence,
    frames: np.ndarray,
    *,
    skinning: str,
    push_out: bool,
) -> list[WornGarment]:
    """A garment on its moving wearer, in the world.

    Args:
        garment: triangles at rest on this wearer, root-relative metres.
        garment_type: one of `GARMENTS`.
        record: the wearer in motion.
        frames: (F,) which of its frames.
        skinning, push_out: see `repose`.
    """
    poses = record.poses[frames]
    moved = repose(garment, body, record.shape, poses, skinning=skinning, push_out=push_out)
    sheets = [Mesh(cloth, garment.faces) for cloth in moved]
    return place_clip(sheets, garment_type, body, record, frames)


def place_clip(
    sheets: Sequence[Mesh],
    garment_type: str,
    body: BodyModel,
    record: BodySequence,
    frames: np.ndarray,
) -> list[WornGarment]:
    """Posed sheets of each frame, root-relative metres, with their wearer, in the world.

    See `worn_clip` for the rest.
    """
    clip = []
    for sheet, frame in zip(sheets, frames, strict=True):
        place = record.trans[frame].astype(np.float32)
        (wearer,) = body_sequence_vertices(body, record, world=True, frames=slice(frame, frame + 1))
        clip.append(
            WornGarment(
                garment_type,
                Mesh(sheet.vertices + place, sheet.faces),
                Mesh(wearer, body.faces),
                record.poses[frame, :3],
            )
        )
    return clip


def save_clip(path: str | Path, frames: Sequence[WornGarment]) -> None:
    """Write consecutive frames of one garment on its wearer as an animated glTF file."""
    write_glb(
        path,
        [
            _part("Body", [worn.wearer for worn in frames], BODY_COLOUR),
            _part(frames[0].garment_type, [worn.garment for worn in frames], PLAIN_COLOUR),
        ],
    )


def _part(name: str, meshes: Sequence[Mesh], colour: tuple[float, float, float]) -> ScenePart:
    places = np.stack([mesh.vertices for mesh in meshes])
    return ScenePart(name, meshes[0], colour, lambda start, stop: places[start:stop], len(places))
