"""Simulate an outfit on a moving body: attempts, their measures, and what is judged by these."""

import itertools
import logging
import time
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.sequence import BodySequence, body_sequence_vertices, collision_faces
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import mean_edge_length
from drapeline.geometry.point_cache import PointCache, point_cache_writer, write_point_cache
from drapeline.outfits.fabrics import FABRICS, Fabric
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.rule_log import progress
from drapeline.simulation.attachments import Pins, elastic_shrinkage
from drapeline.simulation.collider import MovingBody, as_published, make_collider
from drapeline.simulation.health import (
    HealthMonitor,
    inevitable_violations,
    summary,
    violations,
    watch,
)
from drapeline.simulation.settings import HealthBounds, SimulationSettings
from drapeline.simulation.solver import Attempt, ClothGarment, ClothSolver, plan_attempt
from drapeline.storage import atomic_folder, load_npz, read_json, save_npz, write_json

_LEAD_FRAMES = 4.0
_BAND_STIFFNESS = 10.0  # of collars and cuffs, two layers of cloth with a lining, in one of them
_CHUNK = 32


def transition_poses(first: np.ndarray, second: np.ndarray, count: int) -> np.ndarray:
    """Poses (count + 1, 72) from the rest pose towards a sequence's first frame (CLOTH3D 3.3).

    Joints turn by quaternion interpolation, starting at rest, and run into the first frame at the
    sequence's own speed, so that the cloth is not kicked when it starts. Unlike in the
    paper, the root joint is at once where it is a few frames before the sequence: a body that lies
    down or turns round in less than a second would fling what it wears.

    Args:
        first, second: (72,) the first two poses of the sequence, axis-angle in radians.
        count: frames between the rest pose, which comes first, and `first`, which comes next.
    """
    share = _smoothstep(np.arange(count + 1) / (count + 1))
    lead = _lead(count + 1 - np.arange(count + 1))
    rest, start, follow = (
        Rotation.from_rotvec(np.array(pose).reshape(24, 3)) for pose in (REST_POSE, first, second)
    )
    way = (rest.inv() * start).as_rotvec()
    turn = (start.inv() * follow).as_rotvec()  # (24, 3) per frame
    poses = np.zeros((count + 1, 24, 3))
    for row in range(count + 1):
        behind = -lead[row] * turn
        path = rest * Rotation.from_rotvec(share[row] * way)
        poses[row] = (path * Rotation.from_rotvec(share[row] * behind)).as_rotvec()
        poses[row, 0] = (start[0] * Rotation.from_rotvec(behind[0])).as_rotvec()
    return poses.reshape(count + 1, 72)


def transition_path(first: np.ndarray, second: np.ndarray, count: int) -> np.ndarray:
    """Root positions (count + 1, 3) that come to `first` (3,) at the sequence's speed."""
    return first - _lead(count + 1 - np.arange(count + 1))[:, None] * (second - first)


def _smoothstep(u: np.ndarray) -> np.ndarray:
    return u * u * (3 - 2 * u)


def _lead(frames_left: np.ndarray) -> np.ndarray:
    """Frames of constant speed before the start, fading out after a few."""
    return _LEAD_FRAMES * (1 - np.exp(-frames_left / _LEAD_FRAMES))


def body_frames(
    body: BodyModel,
    record: BodySequence,
    garment_shape: np.ndarray,
    *,
    shape_frames: int,
    pose_frames: int,
    settle_frames: int,
) -> Iterator[np.ndarray]:
    """World vertices (V, 3) of every simulated frame, transitions first.

    Frame 0 is the body that the garments were made for, of shape plus tightness (10,), in rest
    pose. Over `shape_frames` it takes the wearer's shape, over `pose_frames` the sequence's first
    pose, in which it stands for `settle_frames`; the sequence follows.
    """
    poses, path = _transition(record, pose_frames)
    rest = [
        posed_vertices(body, shape, poses[:1], path[:1])[0][0]
        for shape in (garment_shape, record.shape)
    ]
    for step in range(shape_frames + 1):
        u = np.float32(step / shape_frames)
        share = float(u * u) * (3 - 2 * float(u))  # NumPy 1 and 2 promote plain floats alike
        yield (1 - share) * rest[0] + share * rest[1]
    moving = posed_vertices(body, record.shape, poses[1:], path[1:])[0]
    # Self-collision corrections of the first frame come in gradually.
    fixed = record.fix_frame == 0
    gradual = _smoothstep(np.arange(1, pose_frames + 1) / (pose_frames + 1))
    moving[:, record.fix_vertex[fixed]] += (
        gradual[:, None, None] * record.fix_delta[fixed][None]
    ).astype(np.float32)
    yield from moving
    (still,) = body_sequence_vertices(body, record, world=True, frames=slice(0, 1))
    yield from itertools.repeat(still, settle_frames)
    for start in range(0, len(record.poses), _CHUNK):
        part = slice(start, min(start + _CHUNK, len(record.poses)))
        yield from body_sequence_vertices(body, record, world=True, frames=part)


def rising_floor(lowest_m: np.ndarray, cloth_m: float, count: int) -> np.ndarray:
    """Heights (count,) of the floor in each frame; it lies at 0 once the sequence has begun.

    Garments and bodies at rest may reach through it where the sequence begins on hands and knees.
    So it begins beneath them, and rises during the transition, always beneath the body.

    Args:
        lowest_m: (L,) height of the lowest point of the body in each frame of the transition.
        cloth_m: that of the cloth in the first one.
        count: frames of the transition and the sequence.
    """
    lead = len(lowest_m)
    rising = min(cloth_m, 0.0) * (1 - _smoothstep(np.arange(lead) / lead))
    heights = np.zeros(count)
    heights[:lead] = np.minimum(rising, lowest_m)
    return heights


def place_at_start(points: np.ndarray, record: BodySequence, pose_frames: int) -> np.ndarray:
    """(P, 3) float32 world metres in frame 0 of points of the body at rest, or on it.

    Args:
        points: (P, 3) metres, relative to the root joint, in the rest pose.
    """
    poses, path = _transition(record, pose_frames)
    root, rest = (Rotation.from_rotvec(np.array(pose[:3])) for pose in (poses[0], REST_POSE))
    return ((root * rest.inv()).apply(points) + path[0]).astype(np.float32)


def _transition(record: BodySequence, count: int) -> tuple[np.ndarray, np.ndarray]:
    trans = np.asarray(record.trans, dtype=np.float64)
    follow = min(1, len(trans) - 1)
    poses = transition_poses(record.poses[0], record.poses[follow], count)
    return poses, transition_path(trans[0], trans[follow], count)


LOGGER = logging.getLogger("drapeline")


@dataclass(frozen=True)
class DressedBody:
    """Whom and what is simulated."""

    body: BodyModel
    motion: BodySequence  # the wearer's shape and poses, free of self-collisions
    outfit: Outfit  # garments in rest pose, root-relative, from inner to outer

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


class Judged(NamedTuple):
    """Verdict on a simulation."""

    # "accepted", "rejected" or "failed", its `reason`, and how it was made: solver, attempts,
    # times, versions, fabrics.
    status: dict[str, Any]
    folder: Path  # with `{Garment}.f32` and `health.npz` of the last attempt

    @property
    def accepted(self) -> bool:
        """Whether the sample keeps to its bounds."""
        return self.status["status"] == "accepted"


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

    Returns:
        What `status.json` holds: see `Judged.status`.
    """
    with atomic_folder(output_dir) as folder, TemporaryDirectory(dir=folder) as name:
        first, further = Path(name) / "first", Path(name) / "further"
        measure_outfit(first, dressed, solver, settings=settings, bounds=bounds)
        judged = judge_outfit(first, further, dressed, lambda: solver, settings, bounds)
        if judged.accepted:
            for file in (*judged.folder.glob("*.f32"), judged.folder / "health.npz"):
                file.rename(folder / file.name)
        write_json(folder / "status.json", judged.status)
    return judged.status


def measure_outfit(
    output_dir: str | Path,
    dressed: DressedBody,
    solver: ClothSolver,
    *,
    settings: SimulationSettings | Attempt,
    number: int = 0,
    bounds: HealthBounds | None = None,
) -> dict[str, Any]:
    """Make one attempt at simulating an outfit, and measure every frame; nothing is judged.

    Writes `{Garment}.f32`, `health.npz` (see `HealthMonitor.arrays`) and `attempt.json`. On a body
    that intersects itself there is no attempt, and only the last is written.

    Args:
        settings: from which the attempt is planned, or those of an attempt itself.
        number: 0 for the first attempt, see `plan_attempt`.
        bounds: those that nothing to come can bring the sample back into end the attempt.

    Returns:
        What `attempt.json` holds: `solver`, `versions`, `fabrics`, and `attempt`: its settings,
        measures and times, and why it ended early (`failure`); `None` if there was none.
    """
    garments, motion = dressed.outfit.garments, dressed.motion
    record: dict[str, Any] = {
        "attempt": None,
        "solver": {"name": solver.name, "settings": dict(solver.settings)},
        "versions": {**solver.versions(), "numpy": np.__version__},
        "fabrics": {g.name: asdict(_fabric(g)) for g in garments},
    }
    # On several threads some processors' matrix products, as of the body, round differently.
    with threadpool_limits(1, user_api="blas"), atomic_folder(output_dir) as folder:
        if motion.outcome != "rejected":
            attempt = settings
            if isinstance(attempt, SimulationSettings):
                counts = [len(g.vertices) for g in garments]
                attempt = plan_attempt(number, attempt, counts, motion.poses)
            record["attempt"] = _attempt(folder, dressed, solver, attempt, bounds)
        write_json(folder / "attempt.json", record)
    return record


# There is no attempt on a body that intersects itself.
_RECORD = {"attempt": object, "solver": {"name": str}, "versions": dict, "fabrics": dict}


def judge_outfit(
    first: str | Path,
    further: str | Path,
    dressed: DressedBody,
    solver: Callable[[], ClothSolver],
    settings: SimulationSettings,
    bounds: HealthBounds,
) -> Judged:
    """Judge the first attempt at simulating an outfit, and repeat it where it is out of bounds.

    Args:
        first: folder that `measure_outfit` made.
        further: folder for attempts to come.
        dressed: whom and what was simulated.
        solver: gives the solver of attempts to come.
        settings: with the number of attempts.
        bounds: what an accepted sample holds.

    Raises:
        InputError: a file of the first attempt is missing or damaged.
    """
    record, place = read_json(Path(first) / "attempt.json", _RECORD), Path(first)
    motion = dressed.motion
    verdict, reason = "rejected", motion.reason
    reports: list[dict[str, Any]] = []
    while record["attempt"] is not None:
        number = len(reports)
        verdict, reason = _judge(place, record["attempt"], len(motion.poses), bounds)
        reports.append({**record["attempt"], "status": verdict, "reason": reason})
        if verdict == "accepted":
            break
        LOGGER.info("attempt %d: %s", number + 1, reason)
        if number + 1 >= settings.attempts:
            break
        place = Path(further) / str(number + 1)
        record = measure_outfit(
            place, dressed, solver(), settings=settings, number=number + 1, bounds=bounds
        )
    for report in reports:
        del report["failure"]
    status = {
        "status": verdict,
        "reason": reason,
        "solver": record["solver"],
        "attempts": reports,
        "timing": {"total_s": sum(report["seconds"] for report in reports)},
        "frames_per_second": reports[-1]["frames_per_second"] if reports else 0.0,
        "versions": record["versions"],
        "fabrics": record["fabrics"],
    }
    return Judged(status, place)


def _judge(
    folder: Path, report: Mapping[str, Any], frames: int, bounds: HealthBounds
) -> tuple[str, str]:
    """Status of an attempt, and its reason if it is not accepted."""
    if report["failure"]:
        return "failed", report["failure"]
    health = load_npz(folder / "health.npz", {"*": "any|nan frames ..."})
    measured = len(health["inside_share"])
    if measured < frames:
        certain = inevitable_violations(health, bounds, frames)
        return "rejected", f"{'; '.join(certain)} (by frame {measured - 1})"
    reason = "; ".join(violations(summary(health), bounds))
    return ("rejected" if reason else "accepted"), reason


def _attempt(
    folder: Path,
    dressed: DressedBody,
    solver: ClothSolver,
    attempt: Attempt,
    bounds: HealthBounds | None,
) -> dict[str, Any]:
    """Simulate and measure into the folder, and report."""
    started = time.perf_counter()
    # Of all of the body, as anybody sees it, whatever took part in collisions.
    (_, at_rest), (_, joints) = (
        posed_vertices(dressed.body, shape, poses)
        for shape, poses in (
            (dressed.garment_shape, REST_POSE[None]),
            (dressed.motion.shape, dressed.motion.poses),
        )
    )
    watched = [watch(garment, at_rest[0]) for garment in dressed.outfit.garments]
    monitor = HealthMonitor(watched, dressed.body.faces)
    failure = ""
    with TemporaryDirectory(dir=folder) as name:
        frames = _simulate(dressed, solver, attempt, Path(name))
        try:
            _write_and_measure(folder, dressed, frames, joints, monitor, bounds)
        except InputError:
            raise
        except (RuntimeError, ValueError) as error:
            LOGGER.exception("the simulation broke down")
            failure = str(error) or type(error).__name__
    health = monitor.arrays()
    save_npz(folder / "health.npz", **health)
    whole = monitor.frame_count == len(dressed.motion.poses)
    seconds = time.perf_counter() - started
    return {
        **asdict(attempt),
        "failure": failure,
        **({"measures": _known(summary(health))} if whole and not failure else {}),
        "seconds": seconds,
        "frames_per_second": monitor.frame_count / seconds,
    }


def _known(measures: Mapping[str, float]) -> dict[str, float]:
    """Measures that there are: accelerations, for one, take three frames."""
    return {name: value for name, value in measures.items() if np.isfinite(value)}


def _simulate(
    dressed: DressedBody, solver: ClothSolver, attempt: Attempt, folder: Path
) -> Generator[tuple[list[np.ndarray], np.ndarray, list[np.ndarray] | None]]:
    """Yield garments (V, 3) each and the body (B, 3), root-relative, per frame of the sequence.

    With the first come the garments in the frame before, if the body stood still then.
    """
    motion, outfit = dressed.motion, dressed.outfit
    scratch = folder / "scratch"
    scratch.mkdir()
    bodies = body_frames(
        dressed.body,
        motion,
        dressed.garment_shape,
        shape_frames=attempt.shape_frames,
        pose_frames=attempt.pose_frames,
        settle_frames=attempt.settle_frames,
    )
    write_point_cache(folder / "body.pc2", bodies)
    with PointCache(folder / "body.pc2") as cache:
        placed = [place_at_start(g.vertices, motion, attempt.pose_frames) for g in outfit.garments]
        floor_m = None
        if attempt.floor:
            lead = cache.frames(0, attempt.lead_frames)
            cloth_m = min(vertices[:, 2].min() for vertices in placed)
            floor_m = rising_floor(lead[:, :, 2].min(axis=1), cloth_m, len(cache))
        frames = np.maximum(np.arange(len(cache)) - attempt.lead_frames, 0)
        roots = motion.trans[frames].astype(np.float32)
        segments = dressed.body.segmentation
        body = MovingBody(cache, dressed.faces, segments, floor_m=floor_m, roots=roots)
        garments = [
            _cloth_garment(g, vertices, body, attempt.gap_m)
            for g, vertices in zip(outfit.garments, placed, strict=True)
        ]
        collider = make_collider(body, [g.vertices for g in garments], attempt.collider_share)
        cloths = solver.simulate(garments, collider, attempt, scratch)
        number, before = -attempt.lead_frames, None
        for frame in progress(cloths, total=len(body), label="cloth"):
            if not all(np.isfinite(cloth).all() for cloth in frame):
                raise RuntimeError(f"a vertex is not finite {number} frames into the sequence")
            root = roots[attempt.lead_frames + number]
            relative = [cloth - root for cloth in frame]
            if number == -1 and attempt.settle_frames:
                before = relative
            if number >= 0:
                surface = body.frame(attempt.lead_frames + number)
                yield relative, surface - root, before
                before = None
            number += 1
    if number != len(motion.poses):
        raise RuntimeError(
            f"{solver.name} ended {number} frames into the sequence, expected {len(motion.poses)}"
        )


def _fabric(garment: Garment) -> Fabric:
    name = garment.attributes["fabric"]
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
        stiffness=1 + (_BAND_STIFFNESS - 1) * garment.band.astype(np.float64),
        pins=Pins(garment.pin, vertices, body),
    )


def _write_and_measure(
    folder: Path,
    dressed: DressedBody,
    frames: Generator[tuple[list[np.ndarray], np.ndarray, list[np.ndarray] | None]],
    joints: np.ndarray,
    monitor: HealthMonitor,
    bounds: HealthBounds | None,
) -> None:
    """Write `{Garment}.f32` and measure, frame by frame, until the end, or until it is certain."""
    with closing(frames), ExitStack() as stack:
        writers = [
            stack.enter_context(point_cache_writer(folder / f"{g.name}.f32", len(g.vertices)))
            for g in dressed.outfit.garments
        ]
        for (cloths, body, before), places in zip(frames, joints, strict=True):
            for writer, cloth in zip(writers, cloths, strict=True):
                writer.append(cloth)
            published = [as_published(cloth) for cloth in cloths]
            monitor.add(published, as_published(body), before, places)
            if bounds and inevitable_violations(
                monitor.arrays(), bounds, len(dressed.motion.poses)
            ):
                return
