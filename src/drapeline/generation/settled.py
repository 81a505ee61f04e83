"""Outfits that have hung on a body at rest for a while."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from drapeline.bodies.animation import make_body_sequence
from drapeline.bodies.model import BodyModel
from drapeline.frames import GENDERS, REST_POSE
from drapeline.geometry.point_cache import PointCache
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.outfits.static import StaticOutfit
from drapeline.rule_log import LOGGER, progress
from drapeline.simulation.settings import HealthBounds, SimulationSettings
from drapeline.simulation.simulate import DressedBody, simulate_outfit
from drapeline.simulation.solver import ClothSolver


def settle_static(
    outfits: Sequence[StaticOutfit],
    bodies: Mapping[str, BodyModel],
    solver: ClothSolver,
    *,
    frames: int,
    settings: Mapping[str, Any],
    bounds: Mapping[str, Any],
) -> list[StaticOutfit]:
    """Let each outfit of a shard hang on its wearer; see `settle`.

    Args:
        outfits: with their pins.
        bodies: by gender.
        solver: moves the cloth.
        frames: for which it hangs.
        settings, bounds: of simulations, as in the config.
    """
    how = solver, frames, SimulationSettings(**settings), HealthBounds(**bounds)
    found, kept = [], 0
    for one in progress(outfits, total=len(outfits), label="settled"):
        outfit, reason = settle(one.outfit, bodies[one.outfit.gender], *how)
        found.append(one._replace(outfit=outfit))
        if reason:
            kept += 1
            LOGGER.info("%s stays as it was made: %s", one.name, reason)
    if kept:
        LOGGER.warning("%d of %d outfits stay as they were made", kept, len(outfits))
    return found


def settle(
    outfit: Outfit,
    body: BodyModel,
    solver: ClothSolver,
    frames: int,
    simulation: SimulationSettings,
    bounds: HealthBounds,
) -> tuple[Outfit, str]:
    """The outfit after it has hung on its wearer in the rest pose.

    Garments are made on a form, and real ones sag: sleeves hang down, skirts fall into folds.

    Args:
        outfit: with its pins.
        body: of the wearer's gender.
        solver: moves the cloth.
        frames: for which it hangs, after the wearer has taken its own shape.
        simulation, bounds: as of samples; the pose stays, so `pose_frames` may be 1.

    Returns:
        Garments of the same meshes, and no reason; or the outfit as it was, and why.
    """
    motion = make_body_sequence(
        body,
        outfit.shape,
        np.tile(REST_POSE, (frames, 1)),
        np.zeros((frames, 3)),
        gender=GENDERS.index(outfit.gender),
    )
    if not np.array_equal(motion.shape, outfit.shape):
        return outfit, "the body overlaps itself in the rest pose"
    with TemporaryDirectory() as name:
        folder = Path(name) / "settled"
        dressed = DressedBody(body, motion, outfit)
        status = simulate_outfit(folder, dressed, solver, settings=simulation, bounds=bounds)
        if status["status"] != "accepted":
            return outfit, status["reason"]
        return replace(outfit, garments=tuple(_last_frame(folder, g) for g in outfit.garments)), ""


def _last_frame(folder: Path, garment: Garment) -> Garment:
    with PointCache(folder / f"{garment.name}.f32", len(garment.vertices)) as cache:
        return replace(garment, vertices=cache.frames(len(cache) - 1)[0])
