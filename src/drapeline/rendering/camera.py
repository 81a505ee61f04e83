"""Pinhole cameras in the OpenCV convention: x right, y down, z into the picture."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    Pixel (column i, row j) covers image coordinates [i, i + 1) x [j, j + 1).
    """

    intrinsics: np.ndarray  # (3, 3), focal lengths and principal point in pixels
    world_to_camera: np.ndarray  # (4, 4), world metres to camera metres
    # width, height: of the picture in pixels.
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

    def reduced(self, factor: int) -> "Camera":
        """The camera of a picture with pixels so many times as wide and high, none cut off."""
        scale = np.diag([1 / factor, 1 / factor, 1.0])
        width, height = (-(-side // factor) for side in (self.width, self.height))
        return replace(self, intrinsics=scale @ self.intrinsics, width=width, height=height)

    def rays(self) -> np.ndarray:
        """(H, W, 3) world, from the centre of projection through the centre of each pixel.

        They are as long as to have length one along the optical axis, so that a point at some depth
        is that many rays away.
        """
        column, row = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5)
        pixels = np.stack([column, row, np.ones_like(column)], axis=-1)
        return pixels @ np.linalg.inv(self.intrinsics).T @ self.axes

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Project world points (..., 3) onto the picture.

        Returns:
            Image coordinates (..., 2) in pixels and distances along the optical axis (...) in
            metres; points with a distance <= 0 are behind the camera.
        """
        seen = points @ self.axes.T + self.world_to_camera[:3, 3]
        depth = seen[..., 2]
        return (seen @ self.intrinsics.T)[..., :2] / depth[..., None], depth


def look_at(
    position: np.ndarray, target: np.ndarray, *, focal_px: float, size: tuple[int, int]
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


def frame_points(
    cameras: Sequence[Camera], points: Sequence[np.ndarray], margin: float
) -> list[Camera]:
    """The same views, zoomed by one factor and shifted by one offset to hold all points.

    Where a camera stands and looks does not change; the principal point may leave the middle.

    Args:
        cameras: of one size.
        points: (P, 3) world, metres, before each camera.
        margin: share of the picture's height and width that is left free on each side, at least.
    """
    size = np.array([cameras[0].width, cameras[0].height])
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for camera, seen in zip(cameras, points, strict=True):
        image, _ = camera.project(seen)
        low, high = np.minimum(low, image.min(axis=0)), np.maximum(high, image.max(axis=0))
    zoom = float(((1 - 2 * margin) * size / (high - low)).min())
    framed = []
    for camera in cameras:
        intrinsics = camera.intrinsics.copy()
        intrinsics[:2] *= zoom
        intrinsics[:2, 2] += size / 2 - zoom * (low + high) / 2
        framed.append(replace(camera, intrinsics=intrinsics))
    return framed


def facing_direction(root_rotation: np.ndarray) -> tuple[float, float]:
    """Direction (x, y) that a body faces, or its side where it lies or bends over.

    The root joint's rotation is an axis-angle (3,), rad.
    """
    turn = Rotation.from_rotvec(np.array(root_rotation))
    front, upwards = turn.apply([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    if np.hypot(*front[:2]) < 0.5:
        front = np.array([-upwards[1], upwards[0], 0.0])
    return float(front[0]), float(front[1])


def view_direction(front: Sequence[float], *, turn_deg: float, rise: float) -> np.ndarray:
    """(3,) unit vector from a subject to a camera that stands before it.

    Args:
        front: (x, y) direction that the subject faces.
        turn_deg: how far to the side the camera stands, counterclockwise seen from above.
        rise: height of the camera over the subject, per unit of horizontal distance.
    """
    angle = np.arctan2(front[1], front[0]) + np.radians(turn_deg)
    direction = np.array([np.cos(angle), np.sin(angle), rise])
    return direction / np.linalg.norm(direction)
