"""Whole sequences through trained Garment4D networks, on the device of the networks.

Coordinates are metres relative to the root joint, Z up. F frames, P points, N vertices.
"""

import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import torch
from scipy.ndimage import convolve1d

from drapeline.bodies.model import posed_vertices
from drapeline.bodies.rest_body import rest_body
from drapeline.dataset.windows import window_starts
from drapeline.learning_data.body_relative_points import body_relative_points
from drapeline.metrics.reconstructions import Reconstruction
from drapeline.models.garment4d.body_input import PosedBody
from drapeline.models.garment4d.canonical import CanonicalOutput
from drapeline.models.garment4d.canonical_stage import CanonicalStage
from drapeline.models.garment4d.dressed import proposals, skinning_weights
from drapeline.models.garment4d.posed_stage import PosedStage
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.registration.settings import RefineSettings
from drapeline.registration.to_points import fit_to_points
from drapeline.registration.worn_garments import WornGarmentStatistics

_BATCH = 4  # windows at once


class ReconstructedGarment(NamedTuple):
    """A garment through a sequence, stage by stage; metres, root frame.

    Attributes:
        labels: (F, P) uint8 of the points, or None from a network without segmentation.
        canonical: (N, 3) T(alpha').
        proposal: (F, N, 3) interpolated skinning of it.
        final: (F, N, 3) with the displacements.
        seconds: that all of it took.
    """

    labels: np.ndarray | None
    canonical: np.ndarray
    proposal: np.ndarray
    final: np.ndarray
    seconds: float


class Estimate(NamedTuple):
    """Output of a canonical network for a sequence.

    Attributes:
        labels: (F, P) uint8 of the points, or None from a network without segmentation.
        canonical: (N, 3) metres, T of the mean alpha' of all windows.
        regressed: the same of the alpha that the network started from; None if from none.
        outputs: of the batches of windows, in order.
        seconds: that all of it took.
    """

    labels: np.ndarray | None
    canonical: np.ndarray
    regressed: np.ndarray | None
    outputs: list[CanonicalOutput]
    seconds: float


@torch.inference_mode()
def estimate(
    stage: CanonicalStage,
    points: np.ndarray,
    poses: np.ndarray,
    body: PosedBody,
    *,
    frames: int | None = None,
    stride: int | None = None,
    labels: np.ndarray | None = None,
) -> Estimate:
    """The canonical garment of a whole sequence.

    Args:
        stage: trained.
        points: (F, P, 3) clouds, metres, root frame.
        poses: (F, 72) rad; used by stages with `body_relative_points` alone.
        body: of known shape.
        frames: T of a window; that of the stage's training if None.
        stride: from one window to the next, at most T; T if None.
        labels: (F, P) to choose the garment's points by, instead of the network's own.

    Raises:
        InputError: the sequence is shorter than a window, or the stride longer than one.
    """
    started = time.perf_counter()
    windows = _SequenceWindows(len(points), frames or stage.settings.training.frames, stride)
    if stage.body_relative_points:
        points = body_relative_points(body.model, body.shape, poses, points)
    outputs = list(_estimate_windows(stage, windows, points, labels))
    canonical = _mean_garment(stage, [one.coefficients for one in outputs])
    regressed = None
    if stage.network.regression is not None:
        regressed = _mean_garment(stage, [one.initial_alpha for one in outputs])
    own_labels = _mean_labels(outputs, windows)
    return Estimate(own_labels, canonical, regressed, outputs, time.perf_counter() - started)


def _mean_garment(stage: CanonicalStage, alpha: Sequence[torch.Tensor]) -> np.ndarray:
    """(N, 3) T of the mean of all alpha (B, D)."""
    return stage.network.vertices(torch.cat(alpha).mean(0)[None])[0].cpu().numpy()


@torch.inference_mode()
def reconstruct(
    stage: PosedStage,
    points: np.ndarray,
    poses: np.ndarray,
    body: PosedBody,
    *,
    stride: int | None = None,
    skinning: SkinningSettings | None = None,
    labels: np.ndarray | None = None,
    estimated: Estimate | None = None,
) -> ReconstructedGarment:
    """Both stages on a whole sequence; a frame in several windows gets the mean of them.

    Args:
        stage: trained; it holds the canonical network.
        points: (F, P, 3) clouds, metres, root frame.
        poses: (F, 72) rad.
        body: of known shape.
        stride: from one window to the next, at most T; T if None. The last window is shifted back
            to end with the sequence.
        skinning: of the proposals, where not as in training.
        labels: (F, P) to choose the garment's points by, instead of the network's own.
        estimated: output of its canonical network for all this, if it is known already.

    Raises:
        InputError: the sequence is shorter than a window, or the stride longer than one.
    """
    frames_of_window, faces = stage.settings.training.frames, stage.space.faces
    if estimated is None:
        estimated = estimate(
            stage.canonical,
            points,
            poses,
            body,
            frames=frames_of_window,
            stride=stride,
            labels=labels,
        )
    started = time.perf_counter()
    windows = _SequenceWindows(len(points), frames_of_window, stride)
    canonical = estimated.canonical
    weights = skinning_weights(body, canonical, faces, skinning or stage.settings.skinning)
    transforms = body.transforms(poses)
    proposal = proposals(canonical[None], weights[None], transforms[None])[0]
    vertices, normals = body.pose_surface(poses)
    frames = {
        "proposal": proposal,
        "body": vertices,
        "body_normals": normals,
        "transforms": transforms,
    }
    mean = windows.mean(canonical.shape)
    for chosen, output in zip(windows.batches(), estimated.outputs, strict=True):
        batch = {key: torch.from_numpy(windows.of(chosen, x)) for key, x in frames.items()}
        for key, value in (("worn", canonical), ("weights", weights)):
            batch[key] = torch.from_numpy(value).expand(len(chosen), *value.shape)
        batch = {key: value.to(stage.device) for key, value in batch.items()}
        mean.add(chosen, stage.predict(batch, output.levels)[-1].cpu().numpy())
    final = mean()
    if stage.smooth_passes:
        final = proposal + smooth_over_frames(final - proposal, stage.smooth_passes)
    seconds = estimated.seconds + time.perf_counter() - started
    return ReconstructedGarment(estimated.labels, canonical, proposal, final, seconds)


def smooth_over_frames(values: np.ndarray, passes: int) -> np.ndarray:
    """(F, ...) averaged over frames with weights (1, 2, 1) / 4, so many times; ends repeat."""
    for _ in range(passes):
        values = convolve1d(values, [0.25, 0.5, 0.25], axis=0, mode="nearest")
    return values


class _SequenceWindows:
    """Windows that cover a sequence, a few at a time."""

    def __init__(self, count: int, frames: int, stride: int | None = None) -> None:
        self.count, self.frames = count, frames
        starts = window_starts(count, frames, stride or frames, "to reconstruct")
        self.starts = np.array(starts)

    def batches(self) -> Iterator[np.ndarray]:
        """First frames of the windows, batch by batch."""
        for first in range(0, len(self.starts), _BATCH):
            yield self.starts[first : first + _BATCH]

    def of(self, starts: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Values (F, ...) of windows, (B, T, ...)."""
        rows = starts[:, None] + np.arange(self.frames)
        return np.ascontiguousarray(values[rows])

    def mean(self, shape: Sequence[int]) -> "_Mean":
        """To fill with values of `shape` per frame."""
        return _Mean(self, shape)


class _Mean:
    """Mean over all windows that hold a frame."""

    def __init__(self, windows: _SequenceWindows, shape: Sequence[int]) -> None:
        self._frames = windows.frames
        self._sum = np.zeros((windows.count, *shape), dtype=np.float32)
        self._held = np.zeros(windows.count, dtype=np.float32)

    def add(self, starts: np.ndarray, values: np.ndarray) -> None:
        """Values (B, T, ...) of windows."""
        for start, value in zip(starts, values, strict=True):
            self._sum[start : start + self._frames] += value
            self._held[start : start + self._frames] += 1

    def __call__(self) -> np.ndarray:
        return self._sum / self._held.reshape(-1, *[1] * (self._sum.ndim - 1))


def _estimate_windows(
    stage: CanonicalStage, windows: _SequenceWindows, points: np.ndarray, labels: np.ndarray | None
) -> Iterator:
    for starts in windows.batches():
        cloud = torch.from_numpy(windows.of(starts, points)).to(stage.device)
        if labels is None:
            yield stage.network(cloud)
        else:
            given = windows.of(starts, np.asarray(labels, dtype=np.int64))
            yield stage.network(cloud, torch.from_numpy(given).to(stage.device))


def _mean_labels(outputs: Sequence, windows: _SequenceWindows) -> np.ndarray | None:
    if outputs[0].logits is None:
        return None
    mean = windows.mean(outputs[0].logits.shape[2:])
    for starts, output in zip(windows.batches(), outputs, strict=True):
        mean.add(starts, output.logits.cpu().numpy())
    return mean().argmax(axis=-1).astype(np.uint8)


def refine(
    made: ReconstructedGarment,
    points: np.ndarray,
    poses: np.ndarray,
    body: PosedBody,
    label: int,
    faces: np.ndarray,
    settings: RefineSettings,
    worn_statistics: WornGarmentStatistics | None = None,
) -> np.ndarray:
    """Our variant: a reconstruction fitted to the points that the network labels as the garment.

    Args:
        made: of both stages.
        points, poses, body: that it was made from.
        label: the garment's code in `LABELS`.
        faces: (E, 3) of the template.
        settings: weights.
        worn_statistics: of the type's training sequences, see `training_worn_statistics`.

    Returns:
        (F, N, 3) metres, root frame.
    """
    chosen = made.labels == label
    return fit_to_points(
        made.final,
        points,
        chosen,
        faces,
        made.canonical,
        *body.pose_surface(poses),
        settings,
        proposal=made.proposal,
        worn_statistics=worn_statistics,
    )


def build_reconstruction(
    made: ReconstructedGarment,
    *,
    name: str,
    garment: str,
    faces: np.ndarray,
    points: np.ndarray,
    poses: np.ndarray,
    body: PosedBody,
    number: np.ndarray,
    true: np.ndarray | None = None,
    true_canonical: np.ndarray | None = None,
) -> Reconstruction:
    """A reconstruction with all that figures need; the floor is at the lowest vertex.

    Args:
        made: with labels.
        name: of the sequence.
        garment: type.
        faces: (E, 3) of its template.
        points, poses, body: that it was made from.
        number: (F,) of the frames.
        true, true_canonical: (F, N, 3) and (N, 3); None for scans.
    """
    vertices = posed_vertices(body.model, body.shape, poses)[0]
    return Reconstruction(
        name=name,
        garment=garment,
        faces=faces,
        canonical=made.canonical,
        proposal=made.proposal,
        final=made.final,
        true=made.final[:0] if true is None else true,
        true_canonical=made.canonical[:0] if true_canonical is None else true_canonical,
        points=points,
        labels=made.labels,
        body=vertices,
        rest_body=rest_body(body.model, body.shape),
        body_faces=body.model.faces,
        root_rotation=poses[:, :3],
        root_height=-vertices[..., 2].min(axis=1),
        number=number,
    )
