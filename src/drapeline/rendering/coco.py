"""Boxes, masks and keypoints of people and garments in pictures, in COCO's format.

Format: https://cocodataset.org/#format-data
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from drapeline import __version__
from drapeline.frames import JOINT_NAMES, PARENTS
from drapeline.rendering.camera import Camera

_PERSON = 1  # number of the category; garments follow
_LIMB_M = 0.2  # from the surface to a joint in the same limb, at most
_UNLABELLED, _HIDDEN, _VISIBLE = 0, 1, 2


class CocoDocument:
    """The JSON of pictures of one dressed person, picture after picture."""

    def __init__(self, sample: str, garments: Sequence[str], kinds: Sequence[str]) -> None:
        """Begin without pictures.

        Args:
            sample: said with each picture.
            garments: names of segments 2, 3, ...
            kinds: all garments that there are: categories 2, 3, ... in every document.
        """
        self._sample = sample
        self._segments = {_PERSON + 1 + kinds.index(name): n for n, name in enumerate(garments, 2)}
        self._images: list[dict[str, Any]] = []
        self._annotations: list[dict[str, Any]] = []
        skeleton = [[int(parent) + 1, j + 1] for j, parent in enumerate(PARENTS) if parent >= 0]
        person = {"name": "person", "keypoints": list(JOINT_NAMES), "skeleton": skeleton}
        self._categories: list[dict[str, Any]] = [
            {"id": _PERSON, **person, "supercategory": "person"}
        ]
        for number, name in enumerate(kinds, _PERSON + 1):
            self._categories.append({"id": number, "name": name, "supercategory": "clothing"})

    def add(
        self,
        file_name: str,
        segments: np.ndarray,
        depth: np.ndarray,
        camera: Camera,
        joints: np.ndarray,
    ) -> None:
        """Add a picture and what is seen in it.

        Args:
            file_name: of the picture.
            segments: (H, W), 0 for nothing, 1 for the body, 2, 3, ... for garments.
            depth: (H, W) metres along the optical axis.
            camera: that took it.
            joints: (24, 3) world, metres; visible if no other limb hides them.
        """
        height, width = segments.shape
        number = len(self._images) + 1
        self._images.append(
            {
                **{"id": number, "file_name": file_name, "sample": self._sample},
                **{"width": width, "height": height},
            }
        )
        points = _keypoints(joints, camera, segments > 0, depth)
        about = {
            "keypoints": points.ravel().tolist(),
            "num_keypoints": int((points[:, 2] > _UNLABELLED).sum()),
            "keypoints_3d": joints.tolist(),
        }
        for category in self._categories:
            person = category["id"] == _PERSON
            mask = segments > 0 if person else segments == self._segments.get(category["id"], -1)
            if mask.any():
                self._annotations.append(
                    {
                        "id": len(self._annotations) + 1,
                        "image_id": number,
                        "category_id": category["id"],
                        **_region(mask),
                        **(about if person else {}),
                    }
                )

    def finish(self) -> dict[str, Any]:
        """All that was added."""
        return {
            "info": {"description": f"drapeline {__version__}", "version": "1.0"},
            "images": self._images,
            "annotations": self._annotations,
            "categories": self._categories,
        }


def run_lengths(mask: np.ndarray) -> list[int]:
    """Lengths of runs of a mask (H, W), column after column, beginning with those of 0."""
    flat = np.concatenate([[False], mask.ravel(order="F")])
    ends = np.flatnonzero(flat[1:] != flat[:-1])
    return np.diff([0, *ends, mask.size]).tolist()


def _region(mask: np.ndarray) -> dict[str, Any]:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    size = (columns[-1] - columns[0] + 1, rows[-1] - rows[0] + 1)
    return {
        "bbox": [int(number) for number in (columns[0], rows[0], *size)],
        "area": int(mask.sum()),
        "segmentation": {"size": list(mask.shape), "counts": run_lengths(mask)},
        "iscrowd": 0,
    }


def _keypoints(
    joints: np.ndarray, camera: Camera, person: np.ndarray, depth: np.ndarray
) -> np.ndarray:
    """(24, 3): image coordinates in pixels, and how visible; zeros for those out of the picture."""
    places, distance = camera.project(np.asarray(joints, np.float64))
    inside = (distance > 0) & ((places >= 0) & (places < [camera.width, camera.height])).all(axis=1)
    column, row = np.where(inside[:, None], places, 0).astype(int).T
    near = person[row, column] & (distance < depth[row, column] + _LIMB_M)
    points = np.column_stack([places.round(2), np.where(near, _VISIBLE, _HIDDEN)])
    return np.where(inside[:, None], points, _UNLABELLED)
