"""Whole sequences of point clouds through trained networks, and what users load to do so.

Coordinates are metres relative to the root joint, Z up, where nothing else is said. F frames, at 30
per second, P points of a cloud, N vertices of the garment's template.
"""

import time
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from scipy.ndimage import convolve1d

from drapeline.bodies.model import posed_vertices
from drapeline.bodies.rest_body import rest_body
from drapeline.dataset.scans import ScanSequence, to_scans
from drapeline.dataset.windows import window_starts
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.learning_data.body_relative_points import body_relative_points
from drapeline.learning_data.sequences import SIMULATED
from drapeline.metrics.predictions import Reconstruction
from drapeline.metrics.sequence import BodyFrames
from drapeline.models.garment4d.canonical import CanonicalOutput
from drapeline.models.garment4d.data import (
    BodySequences,
    ShapedBody,
    proposals,
    skinning_weights,
    spread_rows,
)
from drapeline.models.garment4d.final_step import Guess, LaidGarment, Seen
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.models.garment4d.stages import (
    CanonicalStage,
    PosedStage,
    load_posed_files,
    load_stage,
)
from drapeline.models.training.module import BEST, fastest_device
from drapeline.outfits.garment_types import LABELS
from drapeline.registration.settings import RefineSettings
from drapeline.rule_log import LOGGER

_BATCH = 4  # windows at once
_CHOSEN_ON = 8  # validation sequences that the final step's proposals are chosen on
DEFAULT_REFINING = RefineSettings()
_DEFAULT_STAGE = "posed"  # in the folder of a garment type
# In simulated clouds of every type at least every sixth point is the garment's, while networks
# label single points as a garment that is not there.
LEAST_SHARE = 0.02


class ReconstructedGarment(NamedTuple):
    """A garment through a sequence, stage by stage; metres, root frame."""

    labels: np.ndarray  # (F, P) uint8 of the points
    canonical: np.ndarray  # (N, 3) T(alpha')
    proposal: np.ndarray  # (F, N, 3) interpolated skinning of it
    final: np.ndarray  # (F, N, 3) with the displacements
    seconds: float  # that all of it took
    first: np.ndarray  # (N, 3) what the final step begins with


class Estimate(NamedTuple):
    """Output of a canonical network for a sequence."""

    # (F, P) uint8 of the points, or None from a network without segmentation.
    labels: np.ndarray | None
    canonical: np.ndarray  # (N, 3) metres, T of the mean alpha' of all windows
    # The same of the alpha that the network started from; None if from none.
    regressed: np.ndarray | None
    outputs: list[CanonicalOutput]  # of the batches of windows, in order
    seconds: float  # that all of it took

    @property
    def first(self) -> np.ndarray:
        """(N, 3) what the final step begins with: the regression's garment where there is one."""
        return self.canonical if self.regressed is None else self.regressed


@torch.inference_mode()
def estimate(
    stage: CanonicalStage,
    points: np.ndarray,
    poses: np.ndarray,
    body: ShapedBody,
    *,
    frames: int | None = None,
    stride: int | None = None,
    labels: np.ndarray | None = None,
) -> Estimate:
    """The canonical garment of a whole sequence.

    Args:
        points: (F, P, 3) clouds, metres, root frame.
        poses: (F, 72) rad; used by stages with `body_relative_points` alone.
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
    return stage.network.vertices(torch.cat([*alpha]).mean(0)[None])[0].cpu().numpy()


@torch.inference_mode()
def reconstruct(
    stage: PosedStage,
    points: np.ndarray,
    poses: np.ndarray,
    body: ShapedBody,
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
    assert estimated.labels is not None  # a posed stage has a canonical network that segments
    return ReconstructedGarment(
        estimated.labels, canonical, proposal, final, seconds, estimated.first
    )


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


def guess_all(stage: CanonicalStage, sequences: BodySequences) -> Iterator[Guess]:
    """First guesses that the final step is fitted to: none for training without a regression."""
    data = sequences.data
    known = stage.out_of_fold_alpha
    chosen = [s for s in data.of_split("train") if str(data.name[s]) in known]
    for sequence in [*chosen, *spread_rows(data.of_split("val", (SIMULATED,)), _CHOSEN_ON)]:
        rows = data.rows(sequence)
        found = estimate(stage, data.points[rows], data.poses[rows], sequences.body(sequence))
        assert found.labels is not None  # PN++ is no part of a posed stage
        alpha = known.get(str(data.name[sequence]))
        first = found.first
        yield Guess(
            int(sequence),
            data.space.coefficients(first) if alpha is None else alpha.numpy(),
            found.labels,
        )


def body_frames(body: ShapedBody, poses: np.ndarray) -> BodyFrames:
    """The whole body in poses (F, 72), root frame; each frame is posed once, when asked for."""

    @cache
    def vertices(frame: int) -> np.ndarray:
        return posed_vertices(body.model, body.shape, poses[frame][None])[0][0]

    return BodyFrames(vertices, body.model.faces)


def build_reconstruction(
    made: ReconstructedGarment,
    *,
    name: str,
    garment: str,
    faces: np.ndarray,
    points: np.ndarray,
    poses: np.ndarray,
    body: ShapedBody,
    number: np.ndarray,
    true: np.ndarray | None = None,
    true_canonical: np.ndarray | None = None,
) -> Reconstruction:
    """A reconstruction with all that figures need; the floor is at the lowest vertex.

    Args:
        made: with labels.
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


class ReconstructedMotion(NamedTuple):
    """A garment that was reconstructed from point clouds."""

    garment: str  # its type, one of `drapeline.outfits.garment_types.GARMENTS`
    vertices: np.ndarray  # (F, N, 3) float32 metres, in the frame of the clouds
    faces: np.ndarray  # (E, 3) int32, the same in all frames
    # (N, 3) float32 metres, the garment in the rest pose with the root joint at the origin.
    canonical: np.ndarray
    points: np.ndarray  # (F, P, 3) float32, those of the clouds that the networks were given
    # (F, P) uint8, what each of them was taken for: an index into
    # `drapeline.outfits.garment_types.LABELS`, 0 for the body.
    labels: np.ndarray


class ReconstructionSteps(NamedTuple):
    """A reconstruction step by step, relative to the root joint."""

    points: np.ndarray  # (F, P, 3) that the networks were given
    body: ShapedBody  # whose garment it is
    made: ReconstructedGarment  # by the networks
    laid: LaidGarment  # by our final step, or by the networks if it is left out


class ReconstructionModel:
    """Garment4D for one garment type.

    Args:
        folder: of the type, such as `results/garment4d/Skirt`, or of one of its posed stages.
        device: to run on; CUDA where there is such a device if None.

    Attributes:
        folder: with the checkpoint.
        stage: trained networks.
        bodies: of both genders.
        points: of a cloud that the networks were trained on.
        final_step: our final step.

    Raises:
        InputError: a file is missing or damaged, or holds a network of another stage.
    """

    def __init__(self, folder: str | Path, device: torch.device | str | None = None) -> None:
        self.folder = stage_folder(folder)
        stage = load_stage(self.folder, PosedStage)
        self.stage: PosedStage = stage.to(device or fastest_device())
        files = load_posed_files(self.folder, stage)
        self.bodies, self.points, self.final_step = files
        self.garment = LABELS[stage.label]

    def reconstruct(
        self,
        points: np.ndarray | Sequence[np.ndarray],
        poses: np.ndarray,
        shape: np.ndarray | Sequence[float],
        *,
        gender: str = GENDERS[0],
        trans: np.ndarray | None = None,
        refining: RefineSettings | None = DEFAULT_REFINING,
        least_share: float = LEAST_SHARE,
        seed: int = 0,
    ) -> ReconstructedMotion:
        """The garment that a person of known body wears in point clouds.

        Args:
            points: (F, P, 3), or F clouds (n, 3) of different sizes; metres, Z up. Points are
                dropped or repeated as the networks need.
            poses: (F, 72) SMPL's axis-angle, rad; the root rotation takes the body from Y up to
                Z up.
            shape: (10,) SMPL's shape coefficients.
            gender: "female" or "male".
            trans: (F, 3) position of the root joint in the frame of the clouds, metres; the origin
                if None.
            refining: weights of our final step, which lays the garment on the points; None leaves
                it out.
            least_share: of the points that have to be taken for the garment; with fewer, the
                networks would return little more than the mean garment.

        Raises:
            InputError: arrays have other shapes or are not finite, the clouds are not near the
                body, there are fewer frames than the networks take at once, or fewer points than
                `least_share` are taken for the garment.
        """
        poses = np.asarray(poses)
        parameters = {
            "poses": poses,
            "shape": np.asarray(shape),
            "gender": gender,
            "trans": np.zeros((len(np.atleast_1d(poses)), 3)) if trans is None else trans,
        }
        scans = to_scans(points, parameters, self.bodies.models)
        steps = self.reconstruct_steps(
            scans, refining, name="points", seed=seed, least_share=least_share
        )
        root = scans.body.trans.astype(np.float32)[:, None]
        return ReconstructedMotion(
            self.garment,
            steps.laid.final + root,
            self.stage.space.faces,
            steps.laid.canonical,
            steps.points + root,
            steps.made.labels,
        )

    def reconstruct_steps(
        self,
        scans: ScanSequence,
        refining: RefineSettings | None,
        *,
        name: str,
        seed: int,
        least_share: float = LEAST_SHARE,
    ) -> ReconstructionSteps:
        """The same of scans, with what each step makes.

        Args:
            scans: with the body.
            refining: of our final step; None leaves it out.
            least_share: of the points that have to be taken for the garment.

        Raises:
            InputError: there are fewer frames than in a window, or fewer of the garment's points.
        """
        motion, stage = scans.body, self.stage
        clouds = scans.points(self.points, seed=seed)
        body = self.bodies.of(motion.gender, motion.shape)
        made = reconstruct(stage, clouds, motion.poses, body)
        check_labels(name, made.labels == stage.label, self.garment, least_share)
        laid = LaidGarment(made.canonical, made.proposal, made.final)
        if refining is not None:
            seen = Seen(clouds, made.labels, motion.poses, motion.trans, body)
            laid = self.final_step(made.first, seen, refining)
        return ReconstructionSteps(clouds, body, made, laid)


def stage_folder(folder: str | Path) -> Path:
    """A folder with a checkpoint; of one without, such as that of a garment type, its `posed`."""
    folder = Path(folder)
    inner = folder / _DEFAULT_STAGE
    return inner if inner.is_dir() and not (folder / BEST).is_file() else folder


def check_labels(
    name: str, chosen: np.ndarray, garment: str, least_share: float = LEAST_SHARE
) -> None:
    """Refuse scans in which the network finds no such garment: it would return the mean garment.

    Args:
        chosen: (F, P) bool, the points that it labels as the garment's.
        least_share: of them among all points.

    Raises:
        InputError: over all frames they are fewer.
    """
    if chosen.mean() < least_share:
        raise InputError(
            f"{name}: {chosen.mean():.1%} of the points are taken for {garment}, expected"
            f" {least_share:.0%} or more: a person who wears one, and a network trained on"
            " clouds like these"
        )
    for frame in np.flatnonzero(chosen.mean(axis=1) < least_share):
        LOGGER.warning(
            "%s: frame %d: %.1f %% of the points are taken for %s; it follows other frames there",
            name,
            frame + 1,
            100 * chosen[frame].mean(),
            garment,
        )
