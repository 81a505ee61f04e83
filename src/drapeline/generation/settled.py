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
from drapeline.simulation.attempts import SimulationSettings
from drapeline.simulation.health import HealthBounds
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
    return [
        one._replace(outfit=settle(one.outfit, bodies[one.outfit.gender], *how))
        for one in progress(outfits, total=len(outfits), label="settled")
    ]


def settle(
    outfit: Outfit,
    body: BodyModel,
    solver: ClothSolver,
    frames: int,
    simulation: SimulationSettings,
    bounds: HealthBounds,
) -> Outfit:
    """The outfit after it has hung on its wearer in the rest pose.

    Garments are made on a form, and real ones sag: sleeves hang down, skirts fall into folds.

    Args:
        outfit: with its pins.
        body: of the wearer's gender.
        solver: moves the cloth.
        frames: for which it hangs, after the wearer has taken its own shape.
        simulation, bounds: as of samples; the pose stays, so no frames are taken for it.

    Returns:
        Garments of the same meshes; the outfit as it was if its simulation is rejected.
    """
    motion = make_body_sequence(
        body,
        outfit.shape,
        np.tile(REST_POSE, (frames, 1)),
        np.zeros((frames, 3)),
        gender=GENDERS.index(outfit.gender),
    )
    with TemporaryDirectory() as name:
        folder = Path(name) / "settled"
        status = simulate_outfit(
            folder,
            DressedBody(body, motion, outfit),
            solver,
            settings=replace(simulation, pose_frames=1),
            bounds=bounds,
        )
        if status["status"] != "accepted":
            LOGGER.info("an outfit stays as it was made: %s", status["reason"])
            return outfit
        return replace(outfit, garments=tuple(_last_frame(folder, g) for g in outfit.garments))


def _last_frame(folder: Path, garment: Garment) -> Garment:
    with PointCache(folder / f"{garment.name}.f32", len(garment.vertices)) as cache:
        return replace(garment, vertices=cache.frames(len(cache) - 1)[0])
