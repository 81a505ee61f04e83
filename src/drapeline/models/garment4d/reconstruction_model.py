"""Trained Garment4D as users of the library take it: point clouds in, a moving garment out.

Everything comes from the folder that the training of the posed stage left, see `posed_files`. F
frames at 30 per second, P points of a cloud, N vertices of the garment's template.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from drapeline.dataset.labels import LABELS
from drapeline.dataset.scans import ScanSequence, to_scans
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.models.garment4d.body_input import PosedBody
from drapeline.models.garment4d.load import load_stage
from drapeline.models.garment4d.posed_files import load_posed_files
from drapeline.models.garment4d.posed_stage import PosedStage
from drapeline.models.garment4d.reconstruct import ReconstructedGarment, reconstruct, refine
from drapeline.models.training.module import BEST, fastest_device
from drapeline.registration.settings import RefineSettings
from drapeline.rule_log import LOGGER

DEFAULT_REFINING = RefineSettings()
_DEFAULT_STAGE = "posed"  # in the folder of a garment type
# In simulated clouds of every type at least every sixth point is the garment's, while networks
# label single points as a garment that is not there.
LEAST_SHARE = 0.02


class MovingGarment(NamedTuple):
    """A garment that was reconstructed from point clouds.

    Attributes:
        garment: its type, one of `drapeline.outfits.garment_types.GARMENTS`.
        vertices: (F, N, 3) float32 metres, in the frame of the clouds.
        faces: (E, 3) int32, the same in all frames.
        canonical: (N, 3) float32 metres, the garment in the rest pose with the root joint at the
            origin.
        points: (F, P, 3) float32, those of the clouds that the networks were given.
        labels: (F, P) uint8, what each of them was taken for: an index into
            `drapeline.dataset.labels.LABELS`, 0 for the body.
    """

    garment: str
    vertices: np.ndarray
    faces: np.ndarray
    canonical: np.ndarray
    points: np.ndarray
    labels: np.ndarray


class Steps(NamedTuple):
    """A reconstruction step by step, relative to the root joint.

    Attributes:
        points: (F, P, 3) that the networks were given.
        body: whose garment it is.
        made: by the networks.
        final: (F, N, 3) of our last step.
    """

    points: np.ndarray
    body: PosedBody
    made: ReconstructedGarment
    final: np.ndarray


class ReconstructionModel:
    """Garment4D for one garment type.

    Args:
        folder: of the type, such as `results/garment4d/Skirt`, or of one of its posed stages.
        device: to run on; CUDA where there is such a device if None.

    Attributes:
        folder: with the checkpoint.
        garment: the type.
        stage: trained networks.
        bodies: of both genders.
        points: of a cloud that the networks were trained on.
        worn_statistics: of the training sequences; None where there were none.

    Raises:
        InputError: a file is missing or damaged, or holds a network of another stage.
    """

    def __init__(self, folder: str | Path, device: torch.device | str | None = None) -> None:
        self.folder = stage_folder(folder)
        stage = load_stage(self.folder, PosedStage)
        self.stage: PosedStage = stage.to(device or fastest_device())
        self.bodies, self.points, self.worn_statistics = load_posed_files(self.folder)
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
    ) -> MovingGarment:
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
            refining: weights of our last step, which fits the networks' garment to the points; None
                leaves it out.
            least_share: of the points that have to be taken for the garment; with fewer, the
                networks would return little more than the mean garment.
            seed: of the choice of points.

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
        return MovingGarment(
            self.garment,
            steps.final + root,
            self.stage.space.faces,
            steps.made.canonical,
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
    ) -> Steps:
        """The same of scans, with what each step makes.

        Args:
            scans: with the body.
            refining: of our last step; None leaves it out.
            name: of the scans, for errors.
            seed: of the choice of points.
            least_share: of the points that have to be taken for the garment.

        Raises:
            InputError: there are fewer frames than in a window, or fewer of the garment's points.
        """
        motion, stage = scans.body, self.stage
        clouds = scans.points(self.points, seed=seed)
        body = self.bodies.of(GENDERS.index(motion.gender), motion.shape)
        made = reconstruct(stage, clouds, motion.poses, body)
        check_labels(name, made.labels == stage.label, self.garment, least_share)
        final = made.final
        if refining is not None:
            final = refine(
                made,
                clouds,
                motion.poses,
                body,
                stage.label,
                stage.space.faces,
                refining,
                self.worn_statistics,
            )
        return Steps(clouds, body, made, final)


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
        name: of the scans.
        chosen: (F, P) bool, the points that it labels as the garment's.
        garment: its type.
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
