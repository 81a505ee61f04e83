"""Simulate one sample: body, garments, attempts, health, files."""

import logging
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import bpy
import numpy as np

from drapeline.blender.cloth import ClothPiece, Solver, simulate_cloth
from drapeline.blender.fabric_units import cloth_parameters
from drapeline.bodies.model import BodyModel
from drapeline.bodies.sequence import BodySequence, collision_faces
from drapeline.frames import FPS
from drapeline.geometry.mesh import edges
from drapeline.geometry.point_cache import PointCache, point_cache_writer, write_point_cache
from drapeline.outfits.fabrics import FABRICS
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.rule_log import progress
from drapeline.simulation.attachments import Carrier, gathering
from drapeline.simulation.collider import thinned_faces
from drapeline.simulation.health import (
    HealthBounds,
    HealthGarment,
    HealthMonitor,
    out_of_bounds,
    summary,
    surely_out_of_bounds,
)
from drapeline.simulation.reach import parts_within_reach
from drapeline.simulation.settings import SimulationSettings, steps_per_frame
from drapeline.simulation.transitions import body_frames, start_position
from drapeline.storage import atomic_folder, save_npz, write_json

LOGGER = logging.getLogger("drapeline")
_PIN_WEIGHT = 0.9


class NotFinite(Exception):
    """The solver gave a vertex that is not a number."""


class OutOfBounds(Exception):
    """Whatever the frames to come, the sample is going to be out of bounds."""


@dataclass(frozen=True)
class Attempt:
    """Settings of one try."""

    solver: Solver
    collider_share: float
    shape_frames: int
    pose_frames: int


def simulate_outfit(
    output_dir: str | Path,
    *,
    body: BodyModel,
    body_record: BodySequence,
    outfit: Outfit,
    settings: SimulationSettings,
    bounds: HealthBounds,
) -> dict[str, Any]:
    """Simulate an outfit on a moving body and judge the result (CLOTH3D 3.3).

    Writes `{Garment}.f32` (frames, V, 3; root-relative metres, sequence frames only) and
    `health.npz` if accepted, and `status.json` in any case. An attempt out of bounds is repeated
    with finer steps, slower transitions and the whole body to collide with, up to
    `settings.attempts`.

    Args:
        output_dir: folder to make.
        body_record: the wearer, free of self-collisions.
        outfit: garments in rest pose, root-relative, from inner to outer.
        bounds: what an accepted sample holds.

    Returns:
        What `status.json` holds: status "accepted", "rejected" or "failed", reason, attempts.
    """
    started = time.perf_counter()
    tried: list[dict[str, Any]] = []
    status = {"status": "rejected", "reason": body_record.reason}
    with atomic_folder(output_dir) as folder:
        limit = 0 if body_record.outcome == "rejected" else settings.attempts
        for number in range(limit):
            attempt = _attempt(number, body_record, outfit, settings)
            report, arrays = _try(folder, body, body_record, outfit, attempt, bounds)
            tried.append({**asdict(attempt), **report})
            status = {key: report[key] for key in ("status", "reason")}
            if status["status"] == "accepted":
                save_npz(folder / "health.npz", **arrays)
                break
            LOGGER.info("attempt %d: %s", number + 1, status["reason"])
            for garment in outfit.garments:
                (folder / f"{garment.name}.f32").unlink(missing_ok=True)
        seconds = time.perf_counter() - started
        rate = tried[-1]["frames_per_second"] if tried else 0.0
        status |= {
            "attempts": tried,
            "timing": {"total_s": seconds},
            "frames_per_second": rate,
            "versions": {"bpy": bpy.app.version_string, "numpy": np.__version__},
            "fabrics": {g.name: asdict(FABRICS[g.about["fabric"]]) for g in outfit.garments},
        }
        write_json(folder / "status.json", status)
    return status


def _attempt(
    number: int,
    record: BodySequence,
    outfit: Outfit,
    settings: SimulationSettings,
) -> Attempt:
    """The first attempt is as asked; later ones are finer, with longer transitions."""
    speed = float(np.percentile(_joint_speeds(record), 95))
    steps = steps_per_frame(settings, [len(g.vertices) for g in outfit.garments], speed)
    # Blender keeps cloth at its own distance plus the collider's: each gets half of the gap.
    half = settings.gap_m / 2
    solver = Solver(
        steps=round(steps * (1 + 0.5 * number)),
        body_distance_m=half,
        layer_distance_m=half,
    )
    return Attempt(
        solver,
        1.0 if number else settings.collider_share,
        settings.shape_frames,
        settings.pose_frames * (1 + number),
    )


def _joint_speeds(record: BodySequence) -> np.ndarray:
    """Turning speed of every joint times half a metre, the length of a limb: (N - 1, 24) m/s."""
    poses = np.reshape(record.poses, (-1, 24, 3))
    if len(poses) < 2:
        return np.zeros((1, 24))
    return np.linalg.norm(np.diff(poses[:, 1:], axis=0), axis=2) * FPS * 0.5


def _try(
    folder: Path,
    body: BodyModel,
    record: BodySequence,
    outfit: Outfit,
    attempt: Attempt,
    bounds: HealthBounds,
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """One simulation: a report, and health of every frame simulated."""
    started = time.perf_counter()
    monitor = HealthMonitor(
        [_watched(g) for g in outfit.garments],
        collision_faces(body, record),
    )
    report: dict[str, Any]
    try:
        with TemporaryDirectory(dir=folder) as scratch:
            _simulate(folder, Path(scratch), monitor, body, record, outfit, attempt, bounds)
    except OutOfBounds as error:
        report = {"status": "rejected", "reason": str(error)}
    except (NotFinite, RuntimeError, ValueError, np.linalg.LinAlgError) as error:
        LOGGER.exception("the simulation broke down")
        report = {"status": "failed", "reason": str(error)}
    else:
        measures = summary(monitor.arrays())
        wrong = out_of_bounds(measures, bounds)
        report = {
            "status": "rejected" if wrong else "accepted",
            "reason": "; ".join(wrong),
            "measures": measures,
        }
    return {**report, **_speed(monitor, started)}, monitor.arrays()


def _speed(monitor: HealthMonitor, started: float) -> dict[str, float]:
    seconds = time.perf_counter() - started
    return {"seconds": seconds, "frames_per_second": monitor.frame_count / seconds}


def _simulate(
    folder: Path,
    scratch: Path,
    monitor: HealthMonitor,
    body: BodyModel,
    record: BodySequence,
    outfit: Outfit,
    attempt: Attempt,
    bounds: HealthBounds,
) -> None:
    """Run the solver; write and measure the frames of the sequence as they come."""
    lead = attempt.shape_frames + 1 + attempt.pose_frames
    write_point_cache(scratch / "body.pc2", _moving_body(body, record, outfit, attempt))
    with ExitStack() as stack:
        moving = stack.enter_context(PointCache(scratch / "body.pc2"))
        first = moving.frames(0, 1)[0]
        base = start_position(record, attempt.pose_frames).astype(np.float32)
        pieces = [
            _piece(g, g.vertices + base, moving, scratch, 2 * attempt.solver.body_distance_m)
            for g in outfit.garments
        ]
        kept = parts_within_reach(
            body,
            (moving.frames(f, f + 1)[0] for f in range(len(moving))),
            [piece.vertices for piece in pieces],
        )
        faces = collision_faces(body, record)
        faces = thinned_faces(first, faces[kept[faces].all(axis=1)], attempt.collider_share)
        touched, corners = np.unique(faces, return_inverse=True)
        write_point_cache(
            scratch / "collider.pc2",
            (moving.frames(f, f + 1)[0, touched] for f in range(len(moving))),
        )
        writers = [
            stack.enter_context(point_cache_writer(folder / f"{g.name}.f32", len(g.vertices)))
            for g in outfit.garments
        ]
        cloths = simulate_cloth(
            pieces,
            first[touched],
            corners.reshape(faces.shape),
            scratch / "collider.pc2",
            frames=len(moving),
            solver=attempt.solver,
        )
        for index, frame in enumerate(progress(cloths, total=len(moving), label="cloth")):
            if not all(np.isfinite(cloth).all() for cloth in frame):
                raise NotFinite(f"a vertex is not finite {index - lead} frames into the sequence")
            if index < lead:
                continue
            trans = record.trans[index - lead].astype(np.float32)
            relative = [cloth - trans for cloth in frame]
            for writer, cloth in zip(writers, relative, strict=True):
                writer.append(cloth)
            monitor.add(relative, moving.frames(index, index + 1)[0] - trans)
            surely = surely_out_of_bounds(monitor.arrays(), bounds, len(record.poses))
            if surely:
                raise OutOfBounds(f"{'; '.join(surely)} (by frame {index - lead})")


def _moving_body(
    body: BodyModel, record: BodySequence, outfit: Outfit, attempt: Attempt
) -> Iterator[np.ndarray]:
    return body_frames(
        body,
        record,
        _made_for(outfit),
        shape_frames=attempt.shape_frames,
        pose_frames=attempt.pose_frames,
    )


def _made_for(outfit: Outfit) -> np.ndarray:
    """The shape that the garments fit: the wearer's plus tightness."""
    shape = np.array(outfit.shape, dtype=np.float64)
    shape[:2] += outfit.signed_tightness
    return shape


def _piece(
    garment: Garment, vertices: np.ndarray, moving: PointCache, scratch: Path, gap_m: float
) -> ClothPiece:
    """A garment with its fabric, its elastics, and a cache for its waistband if it has one."""
    first = moving.frames(0, 1)[0]
    pin_cache = None
    held = np.flatnonzero(garment.pin)
    if len(held):
        pin_cache = scratch / f"{garment.name}.pc2"
        carrier = Carrier(vertices[held].astype(np.float64), first)
        with point_cache_writer(pin_cache, len(vertices)) as writer:
            for index in range(len(moving)):
                place = vertices.copy()
                place[held] = carrier(moving.frames(index, index + 1)[0])
                writer.append(place)
    return ClothPiece(
        garment.name,
        vertices,
        garment.faces,
        cloth_parameters(FABRICS[garment.about["fabric"]], _mean_edge_m(garment)),
        _PIN_WEIGHT * garment.pin,
        gathering(vertices, garment.faces, garment.elastic, first, gap_m=gap_m),
        pin_cache,
    )


def _watched(garment: Garment) -> HealthGarment:
    """Rest lengths; those of elastics, which are there to give, are not watched."""
    pairs = edges(garment.faces)
    ends = garment.vertices[pairs]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    lengths[(garment.elastic[pairs] > 0).any(axis=1)] = np.nan
    return HealthGarment(garment.name, garment.faces, lengths)


def _mean_edge_m(garment: Garment) -> float:
    ends = garment.vertices[edges(garment.faces)]
    return float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean())
