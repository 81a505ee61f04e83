"""The meshes of a sample, body and garments, moving in the world frame."""

from drapeline.dataset.labels import BODY
from drapeline.dataset.reader import Sample
from drapeline.dataset.scene_part import BODY_COLOUR, PLAIN_COLOUR, ScenePart


def scene_parts(sample: Sample) -> list[ScenePart]:
    """The body of a sample, if it has one, and its garments."""
    parts = []
    if sample.has_body:
        parts.append(
            ScenePart(BODY, sample.body_mesh(), BODY_COLOUR, sample.body_vertices, len(sample))
        )
    for name in sample.garments:
        texture = sample.info.outfit.get(name, {}).get("texture", {})
        colour = tuple(map(float, texture["data"])) if "data" in texture else PLAIN_COLOUR
        parts.append(
            ScenePart(
                name,
                sample.mesh(name),
                colour,
                lambda start, stop, name=name: sample.vertices(name, start, stop),
                len(sample),
            )
        )
    return parts
