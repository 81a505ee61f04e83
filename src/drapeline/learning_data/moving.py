"""Simulated garments with their registrations, sample by sample."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drapeline.dataset.reader import Sample
from drapeline.dataset.record import SPLITS, STATUS, clip_name, read_meta, solver_name
from drapeline.dataset.shards import samples_of
from drapeline.errors import InputError
from drapeline.learning_data.training_rows import rows_like
from drapeline.registration.to_body.dynamic_offsets import SampleGarment, load_sample_garment
from drapeline.storage import read_json


@dataclass(frozen=True)
class MovingGarment:
    """A garment of a simulated sample."""

    # sample, split, name: identify it; `name` is its type.
    sample: str
    split: str
    name: str
    source: str  # cloth solver that moved it
    clip: str  # that the sample moves through
    gender: str
    shape: np.ndarray  # (10,)
    poses: np.ndarray  # (N, 72) rad
    registered: SampleGarment  # its registration in rest pose
    faces: np.ndarray  # (F, 3) triangles of the simulated garment
    cloth: np.ndarray  # (N, C, 3) float32 vertices of the simulated garment, root-relative metres

    def points(self, frames: np.ndarray) -> np.ndarray:
        """(n, M, 3) positions of the registered points in frames (n,)."""
        return self.registered.points(self.cloth[frames])

    def on_vertices(self, points: np.ndarray) -> np.ndarray:
        """(M, 3) points -> (V, 3), zero outside the mask."""
        out = np.zeros((len(self.registered.mask), 3), dtype=np.float32)
        out[self.registered.vertex] = points
        return out


@dataclass(frozen=True)
class MovingFiles:
    """Files of a garment of a simulated sample; not all garments fit into memory."""

    # sample, split, name, source, clip: as of `MovingGarment`.
    sample: str
    split: str
    name: str
    source: str
    clip: str
    folder: Path
    registration: Path  # folder of its registrations

    def load(self) -> MovingGarment:
        """Read the garment.

        Raises:
            InputError: a file is missing or damaged.
        """
        with Sample(self.folder) as sample:
            return MovingGarment(
                sample=self.sample,
                split=self.split,
                name=self.name,
                source=self.source,
                clip=self.clip,
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
        samples: shards of any groups.
        registrations: shards of the same samples' registrations.
        splits: whose samples are wanted.

    Raises:
        InputError: a file is missing or damaged.
    """
    for folder, registration in zip(samples_of(samples), samples_of(registrations), strict=True):
        status = read_json(registration / "status.json", STATUS)
        if status["status"] == "accepted" and status["split"] in splits:
            name, meta = status["id"], read_meta(folder)
            source, clip = solver_name(meta), clip_name(meta, name)
            with Sample(folder) as sample:
                worn = sample.garments
            for garment in worn:
                yield MovingFiles(
                    name, status["split"], garment, source, clip, folder, registration
                )


def load_moving(
    samples: Iterable[str | Path], registrations: Iterable[str | Path], splits: Sequence[str]
) -> dict[str, Iterator[MovingGarment]]:
    """Garments of the accepted samples of splits, each read when its turn comes.

    Args:
        samples, registrations: see `moving_files`.
        splits: to measure; of "train" at most as many garments of each type as of the first split.

    Raises:
        InputError: a file is missing or damaged.
    """
    found: dict[str, list[MovingFiles]] = {split: [] for split in splits}
    for one in moving_files(samples, registrations, splits):
        found[one.split].append(one)
    if "train" in found:
        kinds, wanted = ([one.name for one in found[name]] for name in ("train", splits[0]))
        found["train"] = [found["train"][index] for index in rows_like(kinds, wanted)]
    return {split: (one.load() for one in some) for split, some in found.items()}


def moving_files_test_first(
    samples: Sequence[str | Path], registrations: Sequence[str | Path]
) -> list[MovingFiles]:
    """Files of all garments, those of the test split first and of the training split last.

    Raises:
        InputError: a file is unusable, or no sample was accepted.
    """
    files = list(moving_files(samples, registrations, SPLITS))
    if not files:
        raise InputError(
            f"{Path(registrations[0]).parent}: none of {len(samples_of(samples))} samples was"
            " accepted, expected one or more"
        )
    return sorted(files, key=lambda garment: -SPLITS.index(garment.split))
