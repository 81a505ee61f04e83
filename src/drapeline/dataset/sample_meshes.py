"""The meshes of a sample, body and garments, as what moves in the world."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from drapeline.dataset.labels import BODY
from drapeline.dataset.reader import Sample
from drapeline.geometry.mesh import Mesh

SKIN_COLOUR = (0.62, 0.52, 0.46)
PLAIN_COLOUR = (0.55, 0.6, 0.68)  # garments whose colour is not stored
_CHUNK = 32  # frames held in memory at once


@dataclass(frozen=True)
class ScenePart:
    """One mesh of a sample, body or garment, that moves.

    Attributes:
        name: "Body" or the garment's name.
        mesh: rest pose, root-relative.
        colour: RGB in 0-1.
        read: (start, stop) -> world vertices (stop - start, V, 3), Z up, in metres.
        frame_count: frames there are.
    """

    name: str
    mesh: Mesh
    colour: tuple[float, float, float]
    read: Callable[[int, int], np.ndarray]
    frame_count: int

    def frames(self) -> Iterator[np.ndarray]:
        """World vertices (V, 3) frame by frame; a few are in memory at a time."""
        for start in range(0, self.frame_count, _CHUNK):
            yield from self.read(start, min(start + _CHUNK, self.frame_count))


def scene_parts(sequence: Sample) -> list[ScenePart]:
    """The body, where the sample has one, and the garments."""
    parts = []
    if sequence.has_body:
        parts.append(
            ScenePart(
                BODY, sequence.body_mesh(), SKIN_COLOUR, sequence.body_vertices, len(sequence)
            )
        )
    for name in sequence.garments:
        texture = sequence.info.outfit.get(name, {}).get("texture", {})
        colour = tuple(map(float, texture["data"])) if "data" in texture else PLAIN_COLOUR
        parts.append(
            ScenePart(
                name,
                sequence.mesh(name),
                colour,
                lambda start, stop, name=name: sequence.vertices(name, start, stop),
                len(sequence),
            )
        )
    return parts


def to_y_up(points: np.ndarray) -> np.ndarray:
    """Z-up points (..., 3) in a Y-up frame: what was towards -Y now is towards +Z."""
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1)
