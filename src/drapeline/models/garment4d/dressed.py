"""Sequences whose bodies wear given canonical garments: proposals and batches for the posed stage.

All coordinates are metres relative to the root joint, Z up. S sequences, N vertices of the
template, M body vertices that networks are given, T frames of a window.
"""

from typing import Any

import numpy as np
import torch

from drapeline.bodies.rest_body import rest_body
from drapeline.bodies.weight_transfer import interpolated_weights
from drapeline.models.garment4d.body_input import PosedBody
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.models.garment4d.windows import BodySequences
from drapeline.models.layers.linear import linear_blend_skinning
from drapeline.models.training.batches import ByteCache, count_bytes

_KEPT_BYTES = 512 << 20  # of bodies in motion, and of skinning weights, each


class DressedSequences(BodySequences):
    """Sequences with a canonical garment for each body, skinned to it in one way.

    Args:
        sequences: with their bodies.
        canonical: (S, N, 3) garments that are worn.
        skinning: how they follow the bodies.
    """

    def __init__(
        self, sequences: BodySequences, canonical: np.ndarray, skinning: SkinningSettings
    ) -> None:
        super().__init__(sequences.data, sequences.bodies)
        self.canonical, self.skinning = canonical, skinning
        self._weights: ByteCache[int, np.ndarray] = ByteCache(_KEPT_BYTES)
        self._motions: ByteCache[int, tuple[np.ndarray, ...]] = ByteCache(_KEPT_BYTES)

    def weights(self, sequence: int) -> np.ndarray:
        """(N, 24) float32 skinning weights of the garment that is worn in a sequence."""
        sequence = int(sequence)
        if sequence in self._weights:
            return self._weights[sequence]
        faces = self.data.space.faces
        weights = skinning_weights(
            self.body(sequence), self.canonical[sequence], faces, self.skinning
        )
        self._weights.add(sequence, weights)
        return weights

    def batch(
        self, windows: np.ndarray, frames: int, *, body_relative_points: bool = False
    ) -> dict[str, Any]:
        """Arrays of windows; see `BodySequences.batch`.

        Returns:
            What is given there, and `target` (B, T, N, 3), `poses` (B, T, 72), `body` and
            `body_normals` (B, T, M, 3), `transforms` (B, T, 24, 4, 4), `worn` (B, N, 3),
            `weights` (B, N, 24) and `proposal` (B, T, N, 3).
        """
        batch = super().batch(windows, frames, body_relative_points=body_relative_points)
        chosen, spans = batch["sequence"], self.spans(windows, frames)
        motions = [self._motion(int(s), int(start), frames) for s, start in windows]
        batch |= {
            key: np.stack([motion[part] for motion in motions]).astype(np.float32)
            for part, key in enumerate(("body", "body_normals", "transforms"))
        }
        batch |= {
            "target": np.stack([self.data.garment[span] for span in spans]),
            "poses": np.stack([self.data.poses[span] for span in spans]),
            "worn": self.canonical[chosen].astype(np.float32),
            "weights": np.stack([self.weights(s) for s in chosen]),
        }
        batch["proposal"] = proposals(batch["worn"], batch["weights"], batch["transforms"])
        return batch

    def _motion(self, sequence: int, start: int, frames: int) -> tuple[np.ndarray, ...]:
        """Body vertices, their normals and joint transforms in some frames of a sequence.

        They are kept for the whole sequence while there is room, and otherwise computed for the
        frames asked for alone.
        """
        span, rows = slice(start, start + frames), self.data.rows(sequence)
        if sequence not in self._motions:
            part, count = self._move(sequence, self.data.poses[rows][span]), rows.stop - rows.start
            if not self._motions.has_room(count_bytes(part) // frames * count):
                return part
            whole = part if frames == count else self._move(sequence, self.data.poses[rows])
            self._motions.add(sequence, whole)
        return tuple(x[span] for x in self._motions[sequence])

    def _move(self, sequence: int, poses: np.ndarray) -> tuple[np.ndarray, ...]:
        body = self.body(sequence)
        return *body.pose_surface(poses), body.transforms(poses)


def skinning_weights(
    body: PosedBody, canonical: np.ndarray, faces: np.ndarray, settings: SkinningSettings
) -> np.ndarray:
    """(N, 24) float32 weights of a canonical garment, interpolated from a body's (equation 2).

    Args:
        body: that wears it.
        canonical: (N, 3) garment in the rest pose.
        faces: (E, 3) of the garment.
        settings: of the interpolation.
    """
    return interpolated_weights(
        canonical,
        faces,
        rest_body(body.model, body.shape),
        body.model.weights,
        settings.neighbours,
        settings.passes,
        power=settings.power,
        coincident=settings.coincident,
    )


def proposals(canonical: np.ndarray, weights: np.ndarray, transforms: np.ndarray) -> np.ndarray:
    """(B, T, N, 3) interpolated linear blend skinning of canonical garments (equation 1).

    Args:
        canonical: (B, N, 3).
        weights: (B, N, 24).
        transforms: (B, T, 24, 4, 4).
    """
    with torch.no_grad():
        tensors = map(torch.from_numpy, (canonical, weights, transforms))
        return linear_blend_skinning(*tensors).numpy()


def propose_garment(
    body: PosedBody,
    poses: np.ndarray,
    canonical: np.ndarray,
    faces: np.ndarray,
    settings: SkinningSettings,
) -> np.ndarray:
    """(F, N, 3) proposals of a canonical garment on a body in poses (F, 72)."""
    weights = skinning_weights(body, canonical, faces, settings)
    return proposals(canonical[None], weights[None], body.transforms(poses)[None])[0]
