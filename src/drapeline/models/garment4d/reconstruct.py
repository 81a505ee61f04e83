"""Whole sequences of point clouds through the paper's networks, and what users load to do so.

Coordinates are metres relative to the root joint, Z up, where nothing else is said. F frames, at 30
per second, P points of a cloud, N vertices of the garment's template.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from scipy.ndimage import convolve1d
from scipy.spatial import cKDTree

from drapeline.bodies.model import posed_vertices
from drapeline.bodies.rest_body import rest_body
from drapeline.dataset.scans import ScanSequence, to_scans
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.metrics.predictions import Reconstruction
from drapeline.metrics.sequence import BodyFrames
from drapeline.models.garment4d.canonical import CanonicalOutput
from drapeline.models.garment4d.data import (
    Seen,
    SequenceWindows,
    ShapedBody,
    proposals,
    skinning_weights,
)
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.models.garment4d.stages import (
    CanonicalStage,
    PosedStage,
    load_seen_forms,
    load_stage,
)
from drapeline.models.training.module import fastest_device
from drapeline.outfits.garment_types import LABELS
from drapeline.registration.to_template.garment_space import GarmentSpace
from drapeline.rule_log import LOGGER

# In simulated clouds of every type at least every sixth point is the garment's, while networks
# label single points as a garment that is not there.
LEAST_SHARE = 0.02
_NEXT = 3.0  # distances between points within which a vertex is next to one


class ReconstructedGarment(NamedTuple):
    """A garment through a sequence, step by step; metres, relative to the root joint of `seen`."""

    # The sequence, labelled, with the body that the garment lies on: as it was given, or fitted.
    seen: Seen
    canonical: np.ndarray  # (N, 3) at rest
    proposal: np.ndarray  # (F, N, 3) skinned, or in our model simulated
    final: np.ndarray  # (F, N, 3) moved by displacements, or laid on the points
    seconds: float  # that all of it took

    @property
    def labels(self) -> np.ndarray:
        """(F, P) uint8 of the points."""
        assert self.seen.labels is not None
        return self.seen.labels


class Estimate(NamedTuple):
    """Output of a canonical network for a sequence."""

    # (F, P) uint8 of the points, or None from a network without segmentation.
    labels: np.ndarray | None
    canonical: np.ndarray  # (N, 3) metres, T of the mean alpha' of all windows
    outputs: list[CanonicalOutput]  # of the batches of windows, in order
    seconds: float  # that all of it took


@torch.inference_mode()
def estimate(
    stage: CanonicalStage,
    points: np.ndarray,
    *,
    frames: int | None = None,
    stride: int | None = None,
    labels: np.ndarray | None = None,
) -> Estimate:
    """The canonical garment of a whole sequence.

    Args:
        points: (F, P, 3) clouds, metres, root frame.
        frames: T of a window; that of the stage's training if None.
        stride: from one window to the next, at most T; T if None.
        labels: (F, P) to choose the garment's points by, instead of the network's own.

    Raises:
        InputError: the sequence is shorter than a window, or the stride longer than one.
    """
    started = time.perf_counter()
    windows = SequenceWindows(len(points), frames or stage.settings.training.frames, stride)
    outputs = list(_estimate_windows(stage, windows, points, labels))
    canonical = _mean_garment(stage, [one.coefficients for one in outputs])
    logits = [one.logits.cpu().numpy() for one in outputs if one.logits is not None]
    own_labels = None
    if logits:
        mean = windows.mean(logits[0].shape[2:])
        for starts, values in zip(windows.batches(), logits, strict=True):
            mean.add(starts, values)
        own_labels = mean().argmax(axis=-1).astype(np.uint8)
    return Estimate(own_labels, canonical, outputs, time.perf_counter() - started)


def _mean_garment(stage: CanonicalStage, alpha: Sequence[torch.Tensor]) -> np.ndarray:
    """(N, 3) T of the mean of all alpha (B, D)."""
    return stage.network.vertices(torch.cat([*alpha]).mean(0)[None])[0].cpu().numpy()


@torch.inference_mode()
def reconstruct(
    stage: PosedStage,
    seen: Seen,
    *,
    stride: int | None = None,
    skinning: SkinningSettings | None = None,
    estimated: Estimate | None = None,
) -> ReconstructedGarment:
    """Both stages on a whole sequence; a frame in several windows gets the mean of them.

    Args:
        stage: trained; it holds the canonical network.
        seen: the sequence; labels choose the garment's points instead of the network's own.
        stride: from one window to the next, at most T; T if None. The last window is shifted back
            to end with the sequence.
        skinning: of the proposals, where not as in training.
        estimated: output of its canonical network for all this, if it is known already.

    Raises:
        InputError: the sequence is shorter than a window, or the stride longer than one.
    """
    frames_of_window, faces = stage.settings.training.frames, stage.space.faces
    body, poses = seen.body, seen.poses
    if estimated is None:
        estimated = estimate(
            stage.canonical,
            seen.points,
            frames=frames_of_window,
            stride=stride,
            labels=seen.labels,
        )
    started = time.perf_counter()
    windows = SequenceWindows(len(poses), frames_of_window, stride)
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
    labels = estimated.labels if seen.labels is None else seen.labels
    return ReconstructedGarment(seen._replace(labels=labels), canonical, proposal, final, seconds)


def smooth_over_frames(values: np.ndarray, passes: int) -> np.ndarray:
    """(F, ...) averaged over frames with weights (1, 2, 1) / 4, so many times; ends repeat."""
    for _ in range(passes):
        values = convolve1d(values, [0.25, 0.5, 0.25], axis=0, mode="nearest")
    return values


def _estimate_windows(
    stage: CanonicalStage, windows: SequenceWindows, points: np.ndarray, labels: np.ndarray | None
) -> Iterator[CanonicalOutput]:
    for starts in windows.batches():
        cloud = torch.from_numpy(windows.of(starts, points)).to(stage.device)
        if labels is None:
            yield stage.network(cloud)
        else:
            given = windows.of(starts, np.asarray(labels, dtype=np.int64))
            yield stage.network(cloud, torch.from_numpy(given).to(stage.device))


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
    number: np.ndarray,
    true: np.ndarray | None = None,
    true_canonical: np.ndarray | None = None,
) -> Reconstruction:
    """A reconstruction with all that figures need; the floor is at the lowest vertex.

    Args:
        faces: (E, 3) of its template.
        number: (F,) of the frames.
        true, true_canonical: (F, N, 3) and (N, 3); None for scans.
    """
    seen, body = made.seen, made.seen.body
    vertices = posed_vertices(body.model, body.shape, seen.poses)[0]
    return Reconstruction(
        name=name,
        garment=garment,
        faces=faces,
        canonical=made.canonical,
        proposal=made.proposal,
        final=made.final,
        true=made.final[:0] if true is None else true,
        true_canonical=made.canonical[:0] if true_canonical is None else true_canonical,
        points=seen.points,
        labels=made.labels,
        body=vertices,
        rest_body=rest_body(body.model, body.shape),
        body_faces=body.model.faces,
        root_rotation=seen.poses[:, :3],
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
    # (F, N) bool, which vertices lie next to points of the garment. Where there are none, cloth is
    # as in other frames, or as garments of the type are.
    seen: np.ndarray
    # (F, 72) rad, (F, 3) metres and (10,) of the body that it lies on: as given, or fitted to the
    # points.
    poses: np.ndarray
    trans: np.ndarray
    shape: np.ndarray


class ReconstructionModel(ABC):
    """A trained model of the garments of one type in point clouds.

    Args:
        folder: that its training left.
        device: to run networks on; CUDA where there is such a device if None.

    Attributes:
        folder: with the checkpoint.
        garment: the type.
        space: its shapes at rest.
        bodies: of both genders.
        points: of a cloud that it was trained on.

    Raises:
        InputError: a file is missing or damaged, or holds another model.
    """

    garment: str
    space: GarmentSpace

    def __init__(self, folder: str | Path, device: torch.device | str | None = None) -> None:
        self.folder = Path(folder)
        self.device = torch.device(device or fastest_device())
        self.bodies, self.points = load_seen_forms(self.folder)

    @abstractmethod
    def make(self, seen: Seen) -> ReconstructedGarment:
        """The garment in clouds, by the labels of their points where they are known.

        Raises:
            InputError: there are fewer frames than in a window.
        """

    def reconstruct(
        self,
        points: np.ndarray | Sequence[np.ndarray],
        poses: np.ndarray,
        shape: np.ndarray | Sequence[float],
        *,
        gender: str = GENDERS[0],
        trans: np.ndarray | None = None,
        least_share: float = LEAST_SHARE,
        seed: int = 0,
    ) -> ReconstructedMotion:
        """The garment that a person of known body wears in point clouds.

        Args:
            points: (F, P, 3), or F clouds (n, 3) of different sizes; metres, Z up. Points are
                dropped or repeated as the model needs.
            poses: (F, 72) SMPL's axis-angle, rad; the root rotation takes the body from Y up to
                Z up.
            shape: (10,) SMPL's shape coefficients.
            gender: "female" or "male".
            trans: (F, 3) position of the root joint in the frame of the clouds, metres; the origin
                if None.
            least_share: of the points that have to be taken for the garment; with fewer, the
                model would return little more than the mean garment.

        Raises:
            InputError: arrays have other shapes or are not finite, the clouds are not near the
                body, there are fewer frames than the networks take at once, or fewer points than
                `least_share` are taken for the garment.
        """
        parameters = {"poses": poses, "shape": shape, "gender": gender, "trans": trans}
        scans = to_scans(points, parameters, self.bodies.models)
        made = self.reconstruct_scans(scans, name="points", seed=seed, least_share=least_share)
        seen = made.seen
        root = seen.trans.astype(np.float32)[:, None]
        return ReconstructedMotion(
            self.garment,
            made.final + root,
            self.space.faces,
            made.canonical,
            seen.points + root,
            made.labels,
            self.seen_vertices(made),
            seen.poses,
            seen.trans,
            seen.body.shape,
        )

    def reconstruct_scans(
        self, scans: ScanSequence, *, name: str, seed: int, least_share: float = LEAST_SHARE
    ) -> ReconstructedGarment:
        """The same of scans, with what each step makes.

        Args:
            scans: with the body.
            least_share: of the points that have to be taken for the garment.

        Raises:
            InputError: there are fewer frames than in a window, or fewer of the garment's points.
        """
        motion = scans.body
        clouds = scans.points(self.points, seed=seed)
        body = self.bodies.of(motion.gender, motion.shape)
        made = self.make(Seen(clouds, motion.poses, motion.trans, body))
        chosen = made.seen.taken_for(LABELS.index(self.garment))
        check_labels(name, chosen, self.garment, least_share)
        return made

    def seen_vertices(self, made: ReconstructedGarment) -> np.ndarray:
        """(F, N) bool, which vertices have a point of the garment next to them."""
        own = made.seen.taken_for(LABELS.index(self.garment))
        return seen_vertices(made.final, made.seen.points, own)


class NetworksModel(ReconstructionModel):
    """Garment4D as the paper has it, see `ReconstructionModel`.

    Args:
        folder: of a posed stage, such as `results/garment4d/Skirt/posed`.

    Attributes:
        stage: trained networks.
    """

    def __init__(self, folder: str | Path, device: torch.device | str | None = None) -> None:
        super().__init__(folder, device)
        self.stage = load_stage(self.folder, PosedStage).to(self.device)
        self.garment, self.space = self.stage.garment, self.stage.space

    def make(self, seen: Seen) -> ReconstructedGarment:
        """See `ReconstructionModel`."""
        return reconstruct(self.stage, seen)


def seen_vertices(garment: np.ndarray, points: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """(F, N) bool, which vertices have a point of the garment next to them.

    Args:
        garment: (F, N, 3) metres.
        points: (F, P, 3).
        chosen: (F, P) bool, the garment's.
    """
    seen = np.zeros(garment.shape[:2], dtype=bool)
    for frame, (vertices, cloud, own) in enumerate(zip(garment, points, chosen, strict=True)):
        if own.sum() > 1:
            tree = cKDTree(cloud[own])
            spacing_m = np.median(tree.query(tree.data, k=2)[0][:, 1])
            seen[frame] = tree.query(vertices)[0] < _NEXT * spacing_m
    return seen


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
