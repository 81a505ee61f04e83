"""Outfits that have hung on a body at rest for a while."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from drapeline.bodies.animation import make_body_sequence
from drapeline.bodies.model import BodyModel
from drapeline.frames import REST_POSE
from drapeline.geometry.point_cache import PointCache
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.simulation.settings import HealthBounds, SimulationSettings
from drapeline.simulation.simulate import DressedBody, simulate_outfit
from drapeline.simulation.solver import ClothSolver


class Hanger:
    """Lets outfits hang on their wearers in the rest pose.

    Garments are made on a form, and real ones sag: sleeves hang down, skirts fall into folds.

    Args:
        frames: for which outfits hang, after the wearer has taken its own shape.
    """

    def __init__(
        self,
        solver: ClothSolver,
        *,
        frames: int,
        settings: Mapping[str, Any],
        bounds: Mapping[str, Any],
    ) -> None:
        self._solver, self._frames = solver, frames
        # The pose stays.
        self._settings = SimulationSettings(**{**settings, "pose_frames": 1, "settle_frames": 0})
        self._bounds = HealthBounds(**bounds)

    def hang(self, outfit: Outfit, body: BodyModel) -> tuple[Outfit, str]:
        """The outfit with garments of the same meshes that have sagged.

        Args:
            outfit: with its pins.

        Returns:
            The outfit, and no reason; or the outfit as it was, and why.
        """
        motion = make_body_sequence(
            body,
            outfit.shape,
            np.tile(REST_POSE, (self._frames, 1)),
            np.zeros((self._frames, 3)),
            gender=outfit.gender,
        )
        if not np.array_equal(motion.shape, outfit.shape):
            return outfit, "the body overlaps itself in the rest pose"
        with TemporaryDirectory() as scratch:
            folder = Path(scratch) / "hung"
            dressed = DressedBody(body, motion, outfit)
            status = simulate_outfit(
                folder, dressed, self._solver, settings=self._settings, bounds=self._bounds
            )
            if status["status"] != "accepted":
                return outfit, status["reason"]
            hung = tuple(_last_frame(folder, garment) for garment in outfit.garments)
        return replace(outfit, garments=hung), ""


def _last_frame(folder: Path, garment: Garment) -> Garment:
    with PointCache(folder / f"{garment.name}.f32", len(garment.vertices)) as cache:
        return replace(garment, vertices=cache.frames(len(cache) - 1)[0])
