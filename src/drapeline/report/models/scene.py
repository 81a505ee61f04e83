"""Where pictures of a dressed body are taken from."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drapeline.rendering.camera import Camera, look_at, view_direction
from drapeline.rendering.raytracer import ColouredMesh, raytrace

PICTURE_SIZE = (250, 290)
_DISTANCE_M = 7.0
_TURN_DEG = 24.0
_RISE = 0.12
_MARGIN = 1.12
_FLOOR_SHARE = 0.44  # of a picture's height lies between its middle and the floor


@dataclass(frozen=True)
class Scene:
    """The view of a dressed body that stands, or moves, above the floor.

    Attributes:
        target: (3,) middle of the picture, metres above the floor in Z.
        front: (x, y) direction that the wearer faces.
        height_m: what the height of the picture spans at the target.
        floor_z: height of the floor in the frame of the meshes.
        turn_deg: how far to the side of the front the camera stands.
    """

    target: tuple[float, float, float] = (0.0, 0.0, 0.9)
    front: tuple[float, float] = (0.0, -1.0)
    height_m: float = 2.1
    floor_z: float = 0.0
    turn_deg: float = _TURN_DEG

    def camera(self, size: tuple[int, int]) -> Camera:
        """The camera for pictures of a size (width, height)."""
        direction = view_direction(self.front, turn_deg=self.turn_deg, rise=_RISE)
        target = np.array(self.target)
        return look_at(
            target + _DISTANCE_M * direction,
            target,
            focal_px=size[1] * _DISTANCE_M / self.height_m,
            size=size,
        )

    def picture(
        self,
        parts: Sequence[ColouredMesh],
        size: tuple[int, int] = PICTURE_SIZE,
        samples: int = 10,
    ) -> np.ndarray:
        """(height, width, 3) uint8 picture of meshes, at a size (width, height)."""
        lift = np.array([0.0, 0.0, -self.floor_z])
        lifted = [replace(part, vertices=part.vertices + lift) for part in parts]
        return raytrace(lifted, self.camera(size), floor_centre=self.target[:2], samples=samples)


def fit_scene(
    scene: Scene, meshes: Sequence[np.ndarray], size: tuple[int, int] = PICTURE_SIZE
) -> Scene:
    """The same view, moved and scaled to hold meshes (V, 3) and the floor below them.

    Args:
        scene: gives the side that the camera stands on, and the floor.
        meshes: in the frame of the floor's height.
        size: of the pictures, (width, height) in pixels.
    """
    points = np.concatenate(meshes) - [0, 0, scene.floor_z]
    right = scene.camera(size).axes[0]
    axes = np.array([right, [-right[1], right[0], 0.0]])  # level: across the picture, into it
    along = points @ axes.T
    x, y, _ = (along.min(axis=0) + along.max(axis=0)) / 2 @ axes
    across, deep = np.ptp(along, axis=0)
    nearer = _DISTANCE_M / (_DISTANCE_M - deep / 2)  # what is near looks larger
    height = _MARGIN * nearer * float(max(points[:, 2].max(), across * size[1] / size[0]))
    return replace(scene, target=(float(x), float(y), _FLOOR_SHARE * height), height_m=height)


def share_scale(scenes: Sequence[Scene]) -> list[Scene]:
    """The same views at the smallest of their scales, with the floor at one height."""
    height = max(scene.height_m for scene in scenes)
    middle_z = _FLOOR_SHARE * height
    return [
        replace(scene, height_m=height, target=(*scene.target[:2], middle_z)) for scene in scenes
    ]
