"""The meshes of a sample, body and garments, moving in the world frame."""

from functools import partial

from drapeline.bodies.kinematics import axis_angle_to_matrix
from drapeline.bodies.model import shape_body
from drapeline.dataset.pictures import mean_colour
from drapeline.dataset.reader import Sample, rotation_z
from drapeline.dataset.scene_part import BODY_COLOUR, PLAIN_COLOUR, ScenePart, Skin
from drapeline.errors import InputError
from drapeline.outfits.garment_types import BODY


def scene_parts(sample: Sample) -> list[ScenePart]:
    """The body of a sample, if it has one, and its garments."""
    parts = []
    if sample.has_body:
        read = sample.body_vertices
        skin = _skin(sample)
        parts.append(ScenePart(BODY, sample.body_mesh(), BODY_COLOUR, read, len(sample), skin))
    for name in sample.garments:
        told = sample.info.outfit.get(name, {}).get("texture", {})
        texture = sample.texture(name)
        colour = told.get("data", PLAIN_COLOUR if texture is None else mean_colour(texture))
        red, green, blue = map(float, colour)
        parts.append(
            ScenePart(
                name,
                sample.mesh(name),
                (red, green, blue),
                partial(sample.vertices, name),
                len(sample),
                texture=texture,
            )
        )
    return parts


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
