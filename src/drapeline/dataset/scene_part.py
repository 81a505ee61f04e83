"""A moving mesh of a scene, as exports and pictures take it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drapeline.frames import FPS
from drapeline.geometry.mesh import Mesh

# sRGB, like the colours in `info.mat`.
BODY_COLOUR = (0.74, 0.74, 0.75)  # the light grey of a mannequin
PLAIN_COLOUR = (0.55, 0.6, 0.68)  # of garments without a stored colour
_CHUNK = 32  # frames held in memory at once


@dataclass(frozen=True)
class Skin:
    """How bones move a body, but for what cloth and other limbs press in."""

    rest: np.ndarray  # (V, 3) metres, SMPL's zero pose, Y up, the root joint at the origin
    joints: np.ndarray  # (24, 3) in the same frame
    weights: np.ndarray  # (V, 24), rows sum to 1
    rotations: np.ndarray  # (F, 24, 3, 3) of joints against their parents; the root's to the world
    path: np.ndarray  # (F, 3) world position of the root joint, Z up, metres


@dataclass(frozen=True)
class ScenePart:
    """A moving mesh of a scene: the body or a garment."""

    name: str  # "Body" or the garment's name
    mesh: Mesh  # rest pose, root-relative metres
    colour: tuple[float, float, float]  # sRGB in 0-1, as on a screen
    # (start, stop) -> world vertices (stop - start, V, 3), Z up, in metres.
    read: Callable[[int, int], np.ndarray]
    frame_count: int
    # How bones move it, where that is known; None otherwise.
    read_skin: Callable[[], Skin | None] = lambda: None
    texture: Path | None = None  # picture on the mesh's texture coordinates, in place of the colour

    @property
    def linear_colour(self) -> tuple[float, float, float]:
        """The colour as linear RGB, which materials of glTF, USD and Blender take.

        Source: IEC 61966-2-1.
        """
        encoded = np.asarray(self.colour, np.float64)
        linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
        return tuple(linear.tolist())

    def velocities(self, start: int, stop: int) -> np.ndarray:
        """World velocities of frames [start, stop), (stop - start, V, 3) in m/s.

        Central differences, one-sided in the first and the last frame of the sequence; 0 if it has
        only one.
        """
        first, last = max(start - 1, 0), min(stop + 1, self.frame_count)
        points = self.read(first, last).astype(np.float64)
        if self.frame_count == 1:
            return np.zeros_like(points)
        return np.gradient(points, 1 / FPS, axis=0)[start - first : stop - first]

    def frames(self) -> Iterator[np.ndarray]:
        """Yield the world vertices (V, 3) of each frame, reading a few frames at a time."""
        for start in range(0, self.frame_count, _CHUNK):
            yield from self.read(start, min(start + _CHUNK, self.frame_count))


def to_y_up(points: np.ndarray) -> np.ndarray:
    """Convert points (..., 3) from Z up to Y up; the -Y direction becomes +Z."""
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1)
