"""A toy body in a skirt, and a cloth solver that needs no physics."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from scipy.spatial import KDTree

from drapeline.bodies.animation import make_body_sequence
from drapeline.bodies.model import BodyModel
from drapeline.frames import REST_POSE
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.simulation.collider import MovingBody
from drapeline.simulation.simulate import DressedBody
from drapeline.simulation.solver import Attempt, ClothGarment

FRAMES = 6


def skirt(rows: int = 8, around: int = 36) -> Garment:
    """A cone from the toy body's waist, root-relative; the top row is held."""
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    share = np.repeat(np.linspace(0, 1, rows), around)
    radius = 0.15 + 0.08 * share
    points = np.stack(
        [
            radius * np.tile(np.cos(angle), rows),
            radius * np.tile(np.sin(angle), rows),
            0.08 - 0.25 * share,
        ],
        -1,
    )
    grid = np.arange(rows * around).reshape(rows, around)
    upper, lower = grid[:-1], grid[1:]
    faces = np.stack([lower, np.roll(lower, -1, 1), np.roll(upper, -1, 1), upper], -1)
    pin = np.zeros(rows * around, dtype=np.float32)
    pin[:around] = 1
    return Garment(
        "Skirt",
        points.astype(np.float32),
        faces.reshape(-1, 4).astype(np.int32),
        np.zeros((1, 2), np.float32),
        np.zeros((faces.size // 4, 4), np.int32),
        pin,
        np.zeros_like(pin),
        np.zeros_like(pin),
        {"fabric": "cotton", "texture": {"type": "pattern"}},
    )


def dress(body: BodyModel) -> DressedBody:
    """A skirt on a body that leans sideways as it walks."""
    poses = np.tile(REST_POSE, (FRAMES, 1))
    poses[:, 3] += 0.05 * np.arange(FRAMES)
    trans = np.array([2.0, 1.0, 1.0]) + 0.01 * np.arange(FRAMES)[:, None]
    return DressedBody(
        body,
        make_body_sequence(body, np.zeros(10), poses, trans, gender="female"),
        Outfit((skirt(),), np.zeros(10), np.zeros(2), np.zeros(2), "female"),
    )


Change = Callable[[int, np.ndarray, np.ndarray, Attempt], np.ndarray]


@dataclass(frozen=True)
class Follower:
    """A solver whose vertices follow the nearest vertex of the body.

    Attributes:
        change: frame, vertices (V, 3), those of the body that they follow, attempt -> vertices,
            what the solver does wrong.
    """

    change: Change = lambda frame, vertices, followed, attempt: vertices

    name: ClassVar[str] = "follower"
    settings: ClassVar[dict[str, int]] = {"neighbours": 1}

    def versions(self) -> dict[str, str]:
        """None but its own."""
        return {"follower": "1"}

    def simulate(
        self,
        garments: Sequence[ClothGarment],
        body: MovingBody,
        attempt: Attempt,
        scratch: Path,
    ) -> Iterator[list[np.ndarray]]:
        """As `ClothSolver` says."""
        first = body.frame(0)
        nearest = [KDTree(first).query(garment.vertices)[1] for garment in garments]
        for index, now in enumerate(body):
            yield [
                self.change(index, garment.vertices + now[near] - first[near], now[near], attempt)
                for garment, near in zip(garments, nearest, strict=True)
            ]


def cloth_solver(threads: int, accelerator: str = "cpu") -> Follower:
    """As each solver's module has it."""
    return Follower()
