"""Simulated garments in motion: their ground truth, trivial predictions, and how good any are."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.dataset.reader import Sequence as Sample
from drapeline.dataset.splits import SPLITS
from drapeline.errors import InputError
from drapeline.metrics.garment_metrics import garment_measures, garment_mesh, inside_measures
from drapeline.metrics.table import MetricRow, summary_rows
from drapeline.outfits.kinds import GARMENTS
from drapeline.registration.dynamic import (
    SampleGarment,
    dressed,
    dynamic_offsets,
    load_sample_garment,
)
from drapeline.registration.topology import Topology
from drapeline.rule_log import progress
from drapeline.seeding import rng_for
from drapeline.storage import read_json

CONTACT_EVERY = 5
STILL, MEAN = "skinned_static", "skinned_mean"


@dataclass(frozen=True)
class MovingGarment:
    """A garment of a simulated sample.

    Attributes:
        sample, split, name: which one; `name` is its type.
        gender: of the wearer.
        shape: (10,).
        poses: (N, 72) rad.
        registered: its registration in rest pose.
        faces: (F, 3) triangles of the simulated garment.
        cloth: (N, C, 3) float32 its vertices, root-relative metres.
    """

    sample: str
    split: str
    name: str
    gender: str
    shape: np.ndarray
    poses: np.ndarray
    registered: SampleGarment
    faces: np.ndarray
    cloth: np.ndarray

    def points(self, frames: np.ndarray) -> np.ndarray:
        """(n, M, 3) where the registered points are."""
        return self.registered.points(self.cloth[frames])

    def on_vertices(self, points: np.ndarray) -> np.ndarray:
        """(M, 3) points -> (V, 3), zero outside of the mask."""
        out = np.zeros((len(self.registered.mask), 3), dtype=np.float32)
        out[self.registered.vertex] = points
        return out


@dataclass(frozen=True)
class MovingFiles:
    """Where a garment of a simulated sample lies, since not all of them fit into memory.

    Attributes:
        sample, split, name: as of `MovingGarment`.
        folder: of the sample.
        registration: folder of its registrations.
    """

    sample: str
    split: str
    name: str
    folder: Path
    registration: Path

    def load(self) -> MovingGarment:
        """Read it.

        Raises:
            InputError: a file is missing or damaged.
        """
        with Sample(self.folder) as sample:
            return MovingGarment(
                sample=self.sample,
                split=self.split,
                name=self.name,
                gender=sample.gender,
                shape=np.asarray(sample.info.shape),
                poses=np.asarray(sample.info.poses),
                registered=load_sample_garment(self.registration / f"{self.name}.npz"),
                faces=sample.mesh(self.name).triangles,
                cloth=sample.vertices(self.name, frame="root"),
            )


def moving_files(
    samples: Iterable[str | Path], registrations: Iterable[str | Path], splits: Sequence[str]
) -> Iterator[MovingFiles]:
    """Garments of the accepted samples of some splits, sample by sample.

    Args:
        samples: folders as `write_sample` leaves them.
        registrations: folders of the same samples as `register_sample` leaves them.
        splits: wanted.

    Raises:
        InputError: a file is missing or damaged.
    """
    for folder, registration in zip(map(Path, samples), map(Path, registrations), strict=True):
        status = read_json(registration / "status.json")
        if status["status"] == "accepted" and status["split"] in splits:
            with Sample(folder) as sample:
                names = sample.garments
            for name in names:
                yield MovingFiles(status["id"], status["split"], name, folder, registration)


def load_moving(
    samples: Iterable[str | Path], registrations: Iterable[str | Path], split: str
) -> Iterator[MovingGarment]:
    """Garments of the accepted samples of a split, each read when it is its turn.

    Args:
        samples, registrations: see `moving_files`.
        split: to load.

    Raises:
        InputError: a file is missing or damaged.
    """
    return (files.load() for files in moving_files(samples, registrations, [split]))


def shown_moving(
    samples: Sequence[str | Path], registrations: Sequence[str | Path]
) -> list[MovingFiles]:
    """All garments for pictures, those of the test split first and those of training last.

    Raises:
        InputError: a file is unusable, or no sample was accepted.
    """
    found = list(moving_files(samples, registrations, SPLITS))
    if not found:
        raise InputError(
            f"{Path(registrations[0]).parent}: none of {len(registrations)} samples was accepted,"
            " expected one or more"
        )
    return sorted(found, key=lambda files: -SPLITS.index(files.split))


def measure_motion(
    moving: MovingGarment,
    frames: np.ndarray,
    predicted: np.ndarray,
    body: BodyModel,
    topology: Topology,
) -> list[dict[str, float]]:
    """Metrics of frames of one garment; what is inside the body only every fifth.

    Args:
        frames: (n,) to measure.
        predicted: (n, M, 3) registered points, root-relative metres.
        body: super-resolved, of the wearer's gender.
        topology: of the super-resolved bodies.
    """
    faces, mask = topology.faces_of(moving.name), moving.registered.mask
    found = []
    for index, (points, true) in enumerate(zip(predicted, moving.points(frames), strict=True)):
        vertices = moving.on_vertices(points)
        # The mask of a garment in motion is its static mask, which nothing predicts.
        measures = garment_measures(vertices, None, moving.on_vertices(true), mask, faces)
        if index % CONTACT_EVERY == 0:
            pose = moving.poses[frames[index]][None]
            posed = posed_vertices(body, moving.shape, pose)[0][0]
            worn = garment_mesh(vertices, faces, mask)
            measures |= inside_measures(worn.vertices, posed, topology.faces)
        found.append(measures)
    return found


class Measured(NamedTuple):
    """Metrics of the frames of one garment.

    Attributes:
        sample, garment: which one.
        rows: metric -> value, per frame.
    """

    sample: str
    garment: str
    rows: Sequence[Mapping[str, float]]


def moving_summary(
    measured: Sequence[Measured],
    *,
    model: str,
    variant: str,
    split: str,
    seed: int,
) -> list[MetricRow]:
    """Rows of the table of metrics over all frames; samples are resampled as wholes."""
    return summary_rows(
        rng_for(seed, "intervals", variant, split),
        [row for one in measured for row in one.rows],
        [one.garment for one in measured for _ in one.rows],
        [one.sample for one in measured for _ in one.rows],
        model=model,
        variant=variant,
        split=split,
        seed=seed,
    )


def mean_wrinkles(
    garments: Iterable[MovingGarment], bodies: Mapping[str, BodyModel], step: int
) -> np.ndarray:
    """(types, V, 3) mean pose-invariant offsets of training garments, per type and vertex.

    Args:
        garments: looked at one after the other.
        bodies: super-resolved, by gender.
        step: of the frames looked at.

    Raises:
        InputError: there are none.
    """
    vertices = len(next(iter(bodies.values())).v_template)
    total = np.zeros((len(GARMENTS), vertices, 3))
    count = np.zeros((len(GARMENTS), vertices, 1))
    for moving in progress(garments, label="mean wrinkles"):
        frames = np.arange(0, len(moving.poses), step)
        offsets = dynamic_offsets(
            moving.registered,
            moving.cloth[frames],
            bodies[moving.gender],
            moving.shape,
            moving.poses[frames],
            "unposed",
        )
        kind = GARMENTS.index(moving.name)
        total[kind] += offsets.sum(axis=0)
        count[kind] += len(frames) * moving.registered.mask[:, None]
    if not count.any():
        raise InputError("no sample of the training split was accepted, expected one or more")
    return (total / np.maximum(count, 1)).astype(np.float32)


def moving_baseline_summary(
    training: Iterable[MovingGarment],
    held_out: Mapping[str, Iterable[MovingGarment]],
    bodies: Mapping[str, BodyModel],
    topology: Topology,
    *,
    step: int,
    seed: int,
) -> list[MetricRow]:
    """The static garment moved by its skinning weights, without and with the type's mean wrinkles.

    Args:
        training: garments that the mean is learned from.
        held_out: split -> garments to measure.
        bodies: super-resolved, by gender.
        step: of the frames measured, and of those that the mean is learned from.
        seed: of the intervals.
    """
    mean = mean_wrinkles(training, bodies, step)
    found = []
    for split, garments in held_out.items():
        measured: dict[str, list[Measured]] = {"moving": [], STILL: [], MEAN: []}
        for moving in progress(garments, label=split):
            body, frames = bodies[moving.gender], np.arange(0, len(moving.poses), step)
            wrinkles = mean[GARMENTS.index(moving.name)] * moving.registered.mask[:, None]
            for name, offsets in ((STILL, np.zeros_like(wrinkles)), (MEAN, wrinkles)):
                points = dressed(
                    moving.registered,
                    np.broadcast_to(offsets, (len(frames), *offsets.shape)),
                    body,
                    moving.shape,
                    moving.poses[frames],
                    "unposed",
                )
                rows = measure_motion(moving, frames, points, body, topology)
                measured[name].append(Measured(moving.sample, moving.name, rows))
            rows = measure_motion(moving, frames, moving.points(frames), body, topology)
            inside = [{k: v for k, v in row.items() if k.startswith("inside")} for row in rows]
            measured["moving"].append(Measured(moving.sample, moving.name, inside))
        for name, rows in measured.items():
            model = "truth" if name == "moving" else "baseline"
            found += moving_summary(rows, model=model, variant=name, split=split, seed=seed)
    return found
