"""Garments in motion for the DVAE: frames of simulated samples as arrays that are mapped."""

from pathlib import Path

import numpy as np

from drapeline.bodies.kinematics import mirrored_poses
from drapeline.learning_data.dynamic import DynamicData
from drapeline.models.gcvae.load import load_vae
from drapeline.models.gcvae.vae import GarmentVae
from drapeline.models.training.batches import Batch, as_tensors
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import GARMENTS


class DynamicGarments:
    """Rows of a `DynamicData` with their conditions, for training, encoding and decoding.

    Args:
        data: frames.
        codes: (G, Z) static code z_s of each garment.
        frames: f, how many poses are conditioned on; 1 to 4.
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

        Static codes in them stay: garments are made alike on both sides.
        """
        return self._cvar(rows, mirrored_poses(self.data.poses[rows, : self.frames]))

    def _cvar(self, rows: np.ndarray, poses: np.ndarray) -> np.ndarray:
        wearer = self.data.wearer[rows]
        flat = poses.reshape(len(rows), -1)
        return np.concatenate([self.data.cvar(wearer), flat, self.codes[wearer]], 1)

    def names(self, rows: np.ndarray) -> list[str]:
        """Sample, garment and frame of rows, for messages."""
        data = self.data
        return [
            f"{data.sample[w]}/{GARMENTS[data.garment[w]]}/{frame}"
            for w, frame in zip(data.wearer[rows], data.frame[rows], strict=True)
        ]

    def batch(self, rows: np.ndarray) -> Batch:
        """Arrays of rows."""
        data, wearer = self.data, self.data.wearer[rows]
        return {
            "offsets": np.asarray(data.offsets[rows]),
            "base": np.asarray(data.base[rows]),
            "mask": np.asarray(data.mask[wearer]),
            "cvar": self.cvar(rows),
            "topology": self.topology(rows),
            "garment": data.garment[wearer],
            "names": self.names(rows),
        }


def static_codes(model: GarmentVae, data: DynamicData) -> np.ndarray:
    """(G, Z) float32: mean static code of each garment."""
    everything = np.arange(len(data.garment))
    return np.concatenate(
        [
            model.encode(as_tensors(data.static_batch(everything[start : start + 16]))).mean.numpy()
            for start in range(0, len(everything), 16)
        ]
    )


def dynamic_garments(folder: str | Path, static: str | Path, frames: int) -> DynamicGarments:
    """Frames with their conditions.

    Args:
        folder: of the rule `collect_dynamic`.
        static: folder of the trained SVAE that gives z_s.
        frames: f, how many poses are conditioned on; 1 to 4.
    """
    data, model = DynamicData(folder), load_vae(Path(static) / BEST)
    return DynamicGarments(data, static_codes(model, data), frames)
