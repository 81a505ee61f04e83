"""The meshes of a sample, body and garments, moving in the world frame."""

from collections.abc import Sequence
from functools import partial

from drapeline.bodies.kinematics import axis_angle_to_matrix
from drapeline.bodies.model import shape_body
from drapeline.dataset.reader import Sample, rotation_z
from drapeline.dataset.scene_part import BODY_COLOUR, PLAIN_COLOUR, ScenePart, Skin
from drapeline.errors import InputError
from drapeline.outfits.garment_types import BODY


def scene_parts(sample: Sample) -> list[ScenePart]:
    """The body of a sample, if it has one, and its garments."""
    parts = []
    if sample.has_body:
        parts.append(
            ScenePart(
                BODY,
                sample.body_mesh(),
                BODY_COLOUR,
                sample.body_vertices,
                len(sample),
                partial(_skin, sample),
            )
        )
    for name in sample.garments:
        red, green, blue = map(float, _colour(sample, name))
        parts.append(
            ScenePart(
                name,
                sample.mesh(name),
                (red, green, blue),
                partial(sample.vertices, name),
                len(sample),
                texture=sample.texture(name),
            )
        )
    return parts


def _colour(sample: Sample, garment: str) -> Sequence[float]:
    """Of a garment, or of most of it where it is printed; a plain one where nothing is told."""
    told = [sample.info.outfit.get(garment, {})]
    if sample.meta is not None:
        garments = sample.meta.get("outfit", {}).get("garments", [])
        told += [one for one in garments if one["name"] == garment]
    colours = (one.get("texture", {}).get("data") for one in told)
    return next((colour for colour in colours if colour is not None), PLAIN_COLOUR)


def _skin(sample: Sample) -> Skin | None:
    """How bones move the body, if its model is known and they alone do."""
    try:
        body = sample.body_model
    except InputError:
        return None
    if body.has_posedirs:
        return None
    info = sample.info
    rest, joints = shape_body(body, info.shape)
    rotations = axis_angle_to_matrix(info.poses.reshape(-1, 24, 3))
    rotations[:, 0] = rotation_z(info.zrot) @ rotations[:, 0]
    root = joints[0]
    return Skin(rest - root, joints - root, body.weights, rotations, sample.root_positions())
