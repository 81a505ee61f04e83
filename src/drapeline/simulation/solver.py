"""Contract of cloth solvers: what they are given, how finely they work, and what they give back."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from drapeline.frames import FPS
from drapeline.outfits.fabrics import Fabric
from drapeline.simulation.attachments import Pins
from drapeline.simulation.collider import MovingBody
from drapeline.simulation.settings import SimulationSettings

_SIMPLE_VERTICES, _COMPLEX_VERTICES = 4_000, 16_000
_CALM_M_S, _FAST_M_S = 1.0, 4.0
_LIMB_M = 0.5


@dataclass(frozen=True)
class Attempt:
    """Settings of one attempt."""

    # Steps per frame, as a measure of quality: CLOTH3D took 14 to 20 of Blender, and a solver of
    # smaller steps takes more of its own in proportion.
    steps: int
    gap_m: float  # distance that cloth keeps from the body, from other garments and from itself
    collider_share: float  # of the body's triangles to collide with
    # shape_frames, pose_frames, settle_frames, floor: as in `SimulationSettings`.
    shape_frames: int
    pose_frames: int
    settle_frames: int
    floor: bool

    @property
    def lead_frames(self) -> int:
        """Frames of transition before the first frame of the sequence."""
        return self.shape_frames + 1 + self.pose_frames + self.settle_frames


def plan_attempt(
    number: int, settings: SimulationSettings, vertex_counts: Sequence[int], poses: np.ndarray
) -> Attempt:
    """The first attempt is as asked; later ones are finer, with longer transitions.

    Args:
        number: 0 for the first attempt.
        vertex_counts: of every garment.
        poses: (N, 72) axis-angle in radians.
    """
    speed = float(np.percentile(_joint_speeds(poses), 95))
    steps = steps_per_frame(settings, vertex_counts, speed)
    return Attempt(
        steps=round(steps * (1 + 0.5 * number)),
        gap_m=settings.gap_m,
        collider_share=1.0 if number else settings.collider_share,
        shape_frames=settings.shape_frames,
        pose_frames=settings.pose_frames * (1 + number),
        settle_frames=settings.settle_frames,
        floor=settings.floor,
    )


def steps_per_frame(
    settings: SimulationSettings, vertex_counts: Sequence[int], speed_m_s: float
) -> int:
    """Solver steps between `steps_min` and `steps_max` by size and speed (CLOTH3D: 14 to 20).

    Args:
        vertex_counts: of every garment; a second layer makes an outfit more complex.
        speed_m_s: 95th percentile of the speed at which joints swing a limb.
    """
    size = (sum(vertex_counts) - _SIMPLE_VERTICES) / (_COMPLEX_VERTICES - _SIMPLE_VERTICES)
    speed = (speed_m_s - _CALM_M_S) / (_FAST_M_S - _CALM_M_S)
    complexity = (min(max(size, 0.0), 1.0) + min(max(speed, 0.0), 1.0)) / 2
    return round(settings.steps_min + complexity * (settings.steps_max - settings.steps_min))


def _joint_speeds(poses: np.ndarray) -> np.ndarray:
    """Turning speed of every joint but the root, times the length of a limb: (N - 1, 23) m/s."""
    poses = np.reshape(poses, (-1, 24, 3))
    if len(poses) < 2:
        return np.zeros((1, 23))
    return np.linalg.norm(np.diff(poses[:, 1:], axis=0), axis=2) * FPS * _LIMB_M


@dataclass(frozen=True)
class ClothGarment:
    """A garment in frame 0: at rest, on the body that it was made for."""

    name: str  # of its type, unique within an outfit
    # (V, 3) float32 world metres; lengths and angles at rest are those between them.
    vertices: np.ndarray
    faces: np.ndarray  # (F, 4) or (F, 3) int32, outward
    edge_length_m: float
    fabric: Fabric
    shrink: np.ndarray  # (V,) 0-1, share by which elastics shorten the rest lengths at a vertex
    # (V,) how many times the fabric's stiffness against bending a vertex has, 1 and more.
    stiffness: np.ndarray
    pins: Pins  # vertices that are held, none where nothing but friction holds the garment


class ClothSolver(Protocol):
    """Moves garments with a body. It knows nothing of attempts, health or files of the dataset.

    A solver lives in a package of its own, with a module that has
    `cloth_solver(threads, accelerator)`, which returns one that takes no more than so many cores,
    and a GPU where "auto" or "gpu" allow it and it can (see docs/how-to/extending.md).
    """

    @property
    def name(self) -> str:
        """What the config calls it."""
        ...

    @property
    def settings(self) -> Mapping[str, Any]:
        """Its own numbers, the same for all garments and attempts, for the record."""
        ...

    def versions(self) -> dict[str, str]:
        """Name -> version of the software that does the work."""
        ...

    def simulate(
        self, garments: Sequence[ClothGarment], body: MovingBody, attempt: Attempt, scratch: Path
    ) -> Iterator[Sequence[np.ndarray]]:
        """Yield the vertices (V, 3) of every garment, world metres, for each frame of the body.

        There are 30 frames per second, the up axis is Z and gravity 9.81 m/s2. The first result is
        the state that was given. Through `attempt.lead_frames` frames the body takes its shape and
        its first pose; they are simulated and thrown away.

        Args:
            garments: from inner to outer; each collides with the body, the others and itself.
            body: what they collide with. It may have holes, as where hands are out of reach, and
                there may be a floor beneath it.
            attempt: how finely, and how far from the body.
            scratch: an empty folder for files, which goes when the attempt ends.

        Raises:
            RuntimeError, ValueError: the solver broke down. Vertices that are not finite need no
                exception: the caller looks for them.
        """
        ...
