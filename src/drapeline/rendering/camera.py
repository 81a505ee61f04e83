"""Pinhole cameras in the OpenCV convention: x right, y down, z into the picture."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    Pixel (column i, row j) covers image coordinates [i, i + 1) x [j, j + 1).

    Attributes:
        intrinsics: (3, 3), focal lengths and principal point in pixels.
        world_to_camera: (4, 4), world metres to camera metres.
        width, height: of the picture in pixels.
    """

    intrinsics: np.ndarray
    world_to_camera: np.ndarray
    width: int
    height: int

    @property
    def position(self) -> np.ndarray:
        """(3,) centre of projection in the world, metres."""
        rotation, shift = self.world_to_camera[:3, :3], self.world_to_camera[:3, 3]
        return -rotation.T @ shift

    @property
    def axes(self) -> np.ndarray:
        """(3, 3) rows: the camera's right, down and forward directions in the world."""
        return self.world_to_camera[:3, :3]

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where world points (..., 3) appear.

        Returns:
            Image coordinates (..., 2) in pixels and distances along the optical axis (...) in
            metres; points with a distance <= 0 are behind the camera.
        """
        seen = points @ self.axes.T + self.world_to_camera[:3, 3]
        depth = seen[..., 2]
        return (seen @ self.intrinsics.T)[..., :2] / depth[..., None], depth


def look_at(
    position: np.ndarray,
    target: np.ndarray,
    *,
    focal_px: float,
    size: tuple[int, int],
) -> Camera:
    """A camera at `position` that has `target` in the middle of the picture and +Z upwards.

    Args:
        position, target: (3,) world, metres; not one above the other.
        focal_px: focal length in pixels.
        size: width and height in pixels.
    """
    width, height = size
    forward = np.asarray(target, np.float64) - position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(forward, right), forward])
    extrinsics = np.eye(4)
    extrinsics[:3, :3] = axes
    extrinsics[:3, 3] = -axes @ position
    intrinsics = np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1.0]])
    return Camera(intrinsics, extrinsics, width, height)
