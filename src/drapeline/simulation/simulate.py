"""Simulate an outfit on a moving body: attempts, judgement, files."""

import logging
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from drapeline.bodies.model import BodyModel
from drapeline.bodies.sequence import BodySequence, collision_faces
from drapeline.errors import InputError
from drapeline.geometry.mesh import mean_edge_length
from drapeline.geometry.point_cache import PointCache, point_cache_writer, write_point_cache
from drapeline.outfits.fabrics import FABRICS, Fabric
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.rule_log import progress
from drapeline.simulation.attachments import Pins, elastic_shrinkage
from drapeline.simulation.attempts import Attempt, plan_attempt
from drapeline.simulation.collider import MovingBody, make_collider
from drapeline.simulation.health import (
    HealthMonitor,
    inevitable_violations,
    summary,
    violations,
    watch,
)
from drapeline.simulation.settings import HealthBounds, SimulationSettings
from drapeline.simulation.solver import ClothGarment, ClothSolver
from drapeline.simulation.transitions import body_frames, place_at_start, rising_floor
from drapeline.storage import atomic_folder, save_npz, write_json

LOGGER = logging.getLogger("drapeline")


class OutOfBounds(Exception):
    """Whatever the frames to come, the sample is going to be out of bounds."""


@dataclass(frozen=True)
class DressedBody:
    """Whom and what is simulated.

    Attributes:
        body: the body model of the wearer's gender.
        motion: the wearer's shape and poses, free of self-collisions.
        outfit: garments in rest pose, root-relative, from inner to outer.
    """

    body: BodyModel
    motion: BodySequence
    outfit: Outfit

    @property
    def faces(self) -> np.ndarray:
        """Faces (F, 3) of the body that take part in collisions."""
        return collision_faces(self.body, self.motion)

    @property
    def garment_shape(self) -> np.ndarray:
        """The shape (10,) that the garments fit: the wearer's plus tightness."""
        shape = np.array(self.outfit.shape, dtype=np.float64)
        shape[:2] += self.outfit.signed_tightness
        return shape


@dataclass(frozen=True)
class AttemptResult:
    """What became of an attempt.

    Attributes:
        status: "accepted", "rejected" or "failed".
        reason: empty if accepted.
        health: measure -> (frames, garments) of all frames that were measured.
        measures: what `HealthBounds` judge, None if the attempt ended early.
    """

    status: str
    reason: str
    health: Mapping[str, np.ndarray] = field(default_factory=dict)
    measures: Mapping[str, float] | None = None


def simulate_outfit(
    output_dir: str | Path,
    dressed: DressedBody,
    solver: ClothSolver,
    *,
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
        bounds: what an accepted sample holds.

    Returns:
        What `status.json` holds: status "accepted", "rejected" or "failed", reason, attempts.
    """
    started = time.perf_counter()
    garments, motion = dressed.outfit.garments, dressed.motion
    reports: list[dict[str, Any]] = []
    status: dict[str, Any] = {"status": "rejected", "reason": motion.reason}
    # On several threads some processors' matrix products, as of the body, round differently.
    with threadpool_limits(1, user_api="blas"), atomic_folder(output_dir) as folder:
        limit = 0 if motion.outcome == "rejected" else settings.attempts
        for number in range(limit):
            attempt = plan_attempt(
                number, settings, [len(g.vertices) for g in garments], motion.poses
            )
            begun = time.perf_counter()
            result = _run_attempt(folder, dressed, solver, attempt, bounds)
            status = {"status": result.status, "reason": result.reason}
            reports.append(_report(attempt, result, time.perf_counter() - begun))
            if result.status == "accepted":
                save_npz(folder / "health.npz", **result.health)
                break
            LOGGER.info("attempt %d: %s", number + 1, result.reason)
        status |= {
            "solver": {"name": solver.name, "settings": dict(solver.settings)},
            "attempts": reports,
            "timing": {"total_s": time.perf_counter() - started},
            "frames_per_second": reports[-1]["frames_per_second"] if reports else 0.0,
            "versions": {**solver.versions(), "numpy": np.__version__},
            "fabrics": {g.name: asdict(_fabric(g)) for g in garments},
        }
        write_json(folder / "status.json", status)
    return status


def _report(attempt: Attempt, result: AttemptResult, seconds: float) -> dict[str, Any]:
    frames = max(map(len, result.health.values()), default=0)
    return {
        **asdict(attempt),
        "status": result.status,
        "reason": result.reason,
        **({} if result.measures is None else {"measures": _known(result.measures)}),
        "seconds": seconds,
        "frames_per_second": frames / seconds,
    }


def _known(measures: Mapping[str, float]) -> dict[str, float]:
    """Measures that there are: accelerations, for one, take three frames."""
    return {name: value for name, value in measures.items() if np.isfinite(value)}


def _run_attempt(
    folder: Path,
    dressed: DressedBody,
    solver: ClothSolver,
    attempt: Attempt,
    bounds: HealthBounds,
) -> AttemptResult:
    """Simulate and measure; the garments' frames come into the folder only if accepted."""
    monitor = HealthMonitor([watch(g) for g in dressed.outfit.garments], dressed.faces)
    with TemporaryDirectory(dir=folder) as name:
        caches = Path(name)
        frames = _simulate(dressed, solver, attempt, caches)
        try:
            _write_and_measure(caches, dressed, frames, monitor, bounds)
        except InputError:
            raise
        except OutOfBounds as error:
            return AttemptResult("rejected", str(error), monitor.arrays())
        except (RuntimeError, ValueError) as error:
            LOGGER.exception("the simulation broke down")
            return AttemptResult("failed", str(error), monitor.arrays())
        measures = summary(monitor.arrays())
        reason = "; ".join(violations(measures, bounds))
        if not reason:
            for cache in caches.glob("*.f32"):
                cache.rename(folder / cache.name)
    return AttemptResult("rejected" if reason else "accepted", reason, monitor.arrays(), measures)


def _simulate(
    dressed: DressedBody, solver: ClothSolver, attempt: Attempt, folder: Path
) -> Iterator[tuple[list[np.ndarray], np.ndarray]]:
    """Yield garments (V, 3) each and the body (B, 3), root-relative, per frame of the sequence."""
    motion, outfit = dressed.motion, dressed.outfit
    scratch = folder / "scratch"
    scratch.mkdir()
    bodies = body_frames(
        dressed.body,
        motion,
        dressed.garment_shape,
        shape_frames=attempt.shape_frames,
        pose_frames=attempt.pose_frames,
    )
    write_point_cache(folder / "body.pc2", bodies)
    with PointCache(folder / "body.pc2") as cache:
        placed = [place_at_start(g.vertices, motion, attempt.pose_frames) for g in outfit.garments]
        floor_m = None
        if attempt.floor:
            lead = cache.frames(0, attempt.lead_frames)
            cloth_m = min(vertices[:, 2].min() for vertices in placed)
            floor_m = rising_floor(lead[:, :, 2].min(axis=1), cloth_m, len(cache))
        body = MovingBody(cache, dressed.faces, dressed.body.segmentation, floor_m=floor_m)
        garments = [
            _cloth_garment(g, vertices, body, attempt.gap_m)
            for g, vertices in zip(outfit.garments, placed, strict=True)
        ]
        collider = make_collider(body, [g.vertices for g in garments], attempt.collider_share)
        cloths = solver.simulate(garments, collider, attempt, scratch)
        number = -attempt.lead_frames
        for frame in progress(cloths, total=len(body), label="cloth"):
            if not all(np.isfinite(cloth).all() for cloth in frame):
                raise RuntimeError(f"a vertex is not finite {number} frames into the sequence")
            if number >= 0:
                trans = motion.trans[number].astype(np.float32)
                surface = body.frame(attempt.lead_frames + number)
                yield [cloth - trans for cloth in frame], surface - trans
            number += 1
    if number != len(motion.poses):
        raise RuntimeError(
            f"{solver.name} ended {number} frames into the sequence, expected {len(motion.poses)}"
        )


def _fabric(garment: Garment) -> Fabric:
    name = garment.about["fabric"]
    if name not in FABRICS:
        raise InputError(f"{garment.name} is of {name!r:.60}, expected {' or '.join(FABRICS)}")
    return FABRICS[name]


def _cloth_garment(
    garment: Garment, vertices: np.ndarray, body: MovingBody, gap_m: float
) -> ClothGarment:
    """A garment in frame 0, where its vertices are (V, 3)."""
    return ClothGarment(
        name=garment.name,
        vertices=vertices,
        faces=garment.faces,
        edge_length_m=mean_edge_length(garment.vertices, garment.faces),
        fabric=_fabric(garment),
        shrink=elastic_shrinkage(
            vertices, garment.faces, garment.elastic, body.frame(0), gap_m=gap_m
        ),
        pins=Pins(garment.pin, vertices, body),
    )


def _write_and_measure(
    folder: Path,
    dressed: DressedBody,
    frames: Iterator[tuple[list[np.ndarray], np.ndarray]],
    monitor: HealthMonitor,
    bounds: HealthBounds,
) -> None:
    """Write `{Garment}.f32` and measure, frame by frame, until the end is certain.

    Raises:
        OutOfBounds: no frames to come can bring the sample back into bounds.
    """
    with closing(frames), ExitStack() as stack:
        writers = [
            stack.enter_context(point_cache_writer(folder / f"{g.name}.f32", len(g.vertices)))
            for g in dressed.outfit.garments
        ]
        for index, (cloths, body) in enumerate(frames):
            for writer, cloth in zip(writers, cloths, strict=True):
                writer.append(cloth)
            monitor.add(cloths, body)
            certain = inevitable_violations(monitor.arrays(), bounds, len(dressed.motion.poses))
            if certain:
                raise OutOfBounds(f"{'; '.join(certain)} (by frame {index})")
