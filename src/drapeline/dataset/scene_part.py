"""A moving mesh of a scene, as exports and pictures take it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from drapeline.geometry.mesh import Mesh

SKIN_COLOUR = (0.62, 0.52, 0.46)
PLAIN_COLOUR = (0.55, 0.6, 0.68)  # of garments without a stored colour
_CHUNK = 32  # frames held in memory at once


@dataclass(frozen=True)
class ScenePart:
    """A moving mesh of a scene: the body or a garment.

    Attributes:
        name: "Body" or the garment's name.
        mesh: rest pose, root-relative metres.
        colour: RGB in 0-1.
        read: (start, stop) -> world vertices (stop - start, V, 3), Z up, in metres.
        frame_count: number of frames.
    """

    name: str
    mesh: Mesh
    colour: tuple[float, float, float]
    read: Callable[[int, int], np.ndarray]
    frame_count: int

    def frames(self) -> Iterator[np.ndarray]:
        """Yield the world vertices (V, 3) of each frame, reading a few frames at a time."""
        for start in range(0, self.frame_count, _CHUNK):
            yield from self.read(start, min(start + _CHUNK, self.frame_count))


def to_y_up(points: np.ndarray) -> np.ndarray:
    """Convert points (..., 3) from Z up to Y up; the -Y direction becomes +Z."""
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1)
