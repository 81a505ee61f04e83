"""The meshes of a sample, body and garments, moving in the world frame."""

from functools import partial

from drapeline.dataset.reader import Sample
from drapeline.dataset.scene_part import BODY_COLOUR, PLAIN_COLOUR, ScenePart
from drapeline.outfits.garment_types import BODY


def scene_parts(sample: Sample) -> list[ScenePart]:
    """The body of a sample, if it has one, and its garments."""
    parts = []
    if sample.has_body:
        parts.append(
            ScenePart(BODY, sample.body_mesh(), BODY_COLOUR, sample.body_vertices, len(sample))
        )
    for name in sample.garments:
        texture = sample.info.outfit.get(name, {}).get("texture", {})
        red, green, blue = map(float, texture.get("data", PLAIN_COLOUR))
        parts.append(
            ScenePart(
                name,
                sample.mesh(name),
                (red, green, blue),
                partial(sample.vertices, name),
                len(sample),
            )
        )
    return parts
