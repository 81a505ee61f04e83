"""Garments in motion as a DVAE takes them: frames with their conditions."""

from pathlib import Path

import numpy as np

from drapeline.bodies.kinematics import mirror_poses
from drapeline.learning_data.dynamic import DynamicData
from drapeline.models.gcvae.codec import GarmentCodec
from drapeline.models.gcvae.load import load_codec
from drapeline.models.training.batches import Batch, as_tensors
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import GARMENTS

_BATCH = 16


class DynamicGarments:
    """Rows of a `DynamicData` with their conditions, for training, encoding and decoding.

    Args:
        data: frames.
        codes: (G, Z) static code z_s of each garment.
        frames: f, the number of poses in the conditions, 1 to 4.
    """

    def __init__(self, data: DynamicData, codes: np.ndarray, frames: int) -> None:
        self.data, self.codes, self.frames = data, codes, frames

    def rows(self, split: str) -> np.ndarray:
        """Indices of the frames of a split."""
        return self.data.rows(split)

    def topology(self, rows: np.ndarray) -> np.ndarray:
        """(n,) codes of `TOPOLOGIES`."""
        return self.data.topology(rows)

    def cvar(self, rows: np.ndarray) -> np.ndarray:
        """(n, 13 + 72 f + Z) float32: static conditions, poses, static code."""
        return self._cvar(rows, self.data.poses[rows, : self.frames])

    def mirrored_cvar(self, rows: np.ndarray) -> np.ndarray:
        """(n, 13 + 72 f + Z) float32: conditions of the rows' mirror images.

        Their static codes are those of the rows: garments are symmetric in rest pose.
        """
        return self._cvar(rows, mirror_poses(self.data.poses[rows, : self.frames]))

    def _cvar(self, rows: np.ndarray, poses: np.ndarray) -> np.ndarray:
        garments = self.data.garment_index[rows]
        flat = poses.reshape(len(rows), -1)
        return np.concatenate([self.data.cvar(garments), flat, self.codes[garments]], 1)

    def names(self, rows: np.ndarray) -> list[str]:
        """Sample, garment and frame of rows, for messages."""
        data = self.data
        return [
            f"{data.sample[g]}/{GARMENTS[data.garment[g]]}/{frame}"
            for g, frame in zip(data.garment_index[rows], data.frame[rows], strict=True)
        ]

    def batch(self, rows: np.ndarray) -> Batch:
        """Arrays of rows."""
        data, garments = self.data, self.data.garment_index[rows]
        return {
            "offsets": np.asarray(data.offsets[rows]),
            "base": np.asarray(data.base[rows]),
            "mask": np.asarray(data.mask[garments]),
            "cvar": self.cvar(rows),
            "topology": self.topology(rows),
            "names": self.names(rows),
        }


def encode_rest_garments(model: GarmentCodec, data: DynamicData) -> np.ndarray:
    """(G, Z) float32: mean static code of each garment."""
    garments = np.arange(len(data.garment))
    return np.concatenate(
        [
            model.encode(
                as_tensors(data.static_batch(garments[start : start + _BATCH]))
            ).mean.numpy()
            for start in range(0, len(garments), _BATCH)
        ]
    )


def load_dynamic_garments(folder: str | Path, static: str | Path, frames: int) -> DynamicGarments:
    """Frames with their conditions.

    Args:
        folder: of the rule `collect_dynamic`.
        static: folder of the trained SVAE that gives z_s.
        frames: f, the number of poses in the conditions, 1 to 4.

    Raises:
        InputError: a file is missing or damaged.
    """
    data, model = DynamicData(folder), load_codec(Path(static) / BEST)
    return DynamicGarments(data, encode_rest_garments(model, data), frames)
