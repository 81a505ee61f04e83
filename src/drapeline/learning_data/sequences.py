"""Garments through sequences: those of one type, collected into arrays that are memory-mapped.

All coordinates are metres relative to the root joint, Z up. Motions have 30 frames per second; a
simulated sequence has all of its frames, a skinned one a few of them. F frames of all sequences, S
sequences, P points of a cloud, N vertices of the template, T frames of a window, D components of
the garment space.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.dataset.windows import window_starts
from drapeline.errors import InputError
from drapeline.frames import GENDERS, gender_names
from drapeline.geometry.mesh import Mesh
from drapeline.learning_data.body_relative_points import body_relative_points
from drapeline.outfits.garment_types import GARMENTS, LABELS
from drapeline.registration.to_template.garment_space import fit_space, load_space
from drapeline.rule_log import progress
from drapeline.seeding import rng_for
from drapeline.storage import (
    ArrayFiles,
    atomic_folder,
    load_npz,
    open_arrays,
    read_json,
    save_npz,
    write_json,
)

# What a sequence is: simulated cloth, or a garment at rest that skinning moves.
SIMULATED, SKINNED = KINDS = ("simulated", "skinned")
_PER_SEQUENCE = {
    **dict.fromkeys(("name", "source", "split", "clip"), "str s"),
    **dict.fromkeys(("start", "count"), "int s"),
    "shape": "float s 10",
    "gender": f"int<{len(GENDERS)} s",
    "canonical": "float s n 3",
    "coefficients": "float s d",
}
_ARRAYS = {
    "points": "float f p 3",
    "labels": "int f p",
    "garment": "float f n 3",
    "on_body": "float f p 4",
    "on_inexact_body": "float f p 4",
}
# Bodies are inexact by a share of these, drawn for each sequence: standard deviations of pose
# parameters in rad, shape coefficients, and the position of the root joint in metres. It is what a
# fit to points without labels leaves of twice as much.
_POSE_NOISE_RAD, _SHAPE_NOISE, _ROOT_NOISE_M = 0.04, 0.4, 0.01


@dataclass(frozen=True)
class GarmentSequence:
    """A garment through one sequence, before it is collected."""

    name: str  # of the sequence; no other of the same type has it
    source: str  # the cloth solver that moved the garment, or `SKINNED` where skinning weights did
    split: str  # "train", "val" or "test"
    clip: str  # that it moves through; of a skinned one, the sample whose motion it has
    gender: str  # "female" or "male"
    shape: np.ndarray  # (10,)
    poses: np.ndarray  # (T, 72) rad
    trans: np.ndarray  # (T, 3) of the root joint in the world, metres
    # (T,) of the frames in the motion, rising; those of skinned sequences may be some frames apart.
    number: np.ndarray
    points: np.ndarray  # (T, P, 3) clouds
    labels: np.ndarray  # (T, P) codes of `LABELS`
    canonical: np.ndarray  # (N, 3) the garment in the rest pose, in template topology
    original: Mesh  # the same before registration, triangles
    # Gives (T, N, 3), the posed garment in template topology, when it is needed.
    garment: Callable[[], np.ndarray]


def collect_sequences(
    output: str | Path,
    garment: str,
    sequences: Sequence[GarmentSequence],
    faces: np.ndarray,
    components: int,
    bodies: Mapping[str, BodyModel],
) -> int:
    """Write all sequences of a type as arrays, and the shape space of the training garments.

    Args:
        output: folder, replaced as a whole.
        faces: (F, 3) of the type's template.
        components: D of the space; fewer where there are few garments.
        bodies: whole, by gender, which points are told a place on: once as they are, and once off
            by noise on pose, shape and root, the same in all frames of a sequence.

    Returns:
        Number of frames written.

    Raises:
        InputError: there are fewer than two training sequences, two sequences have one name, or
            one does not fit the others.
    """
    output = Path(output)
    _check(output, sequences)
    canonical = np.stack([one.canonical for one in sequences]).astype(np.float32)
    trained = np.array([one.split == "train" for one in sequences])
    space = fit_space(canonical[trained], components, faces)
    counts = np.array([len(one.poses) for one in sequences])
    with atomic_folder(output) as scratch:
        _write_clouds_and_garments(scratch, sequences, bodies, output)
        save_npz(
            scratch / "frames.npz",
            poses=np.concatenate([one.poses for one in sequences]).astype(np.float32),
            trans=np.concatenate([one.trans for one in sequences]).astype(np.float32),
            sequence=np.repeat(np.arange(len(sequences)), counts),
            number=np.concatenate([one.number for one in sequences]),
        )
        save_npz(
            scratch / "sequences.npz",
            start=np.cumsum(counts) - counts,
            count=counts,
            canonical=canonical,
            coefficients=space.coefficients(canonical),
            shape=np.stack([one.shape for one in sequences]).astype(np.float32),
            **{
                key: np.array([getattr(one, key) for one in sequences])
                for key in ("name", "source", "split", "clip")
            },
            gender=np.array([GENDERS.index(one.gender) for one in sequences]),
        )
        save_npz(
            scratch / "originals.npz",
            **{
                f"{one.name}/{key}": getattr(one.original, key)
                for one in sequences
                if one.split != "train"
                for key in ("vertices", "faces")
            },
        )
        space.save(scratch / "space.npz")
        write_json(scratch / "about.json", {"garment": garment})
    return int(counts.sum())


def _write_clouds_and_garments(
    folder: Path,
    sequences: Sequence[GarmentSequence],
    bodies: Mapping[str, BodyModel],
    output: Path,
) -> None:
    """Write the arrays with a row per frame, one sequence at a time; `output` is for errors."""
    first, total = sequences[0], sum(len(one.poses) for one in sequences)
    layouts = {
        "points": (np.float32, (total, *first.points.shape[1:])),
        "labels": (np.uint8, (total, *first.labels.shape[1:])),
        "garment": (np.float32, (total, *first.canonical.shape)),
        # Computing these takes longer than an epoch of training.
        "on_body": (np.float32, (total, first.points.shape[1], 4)),
        "on_inexact_body": (np.float32, (total, first.points.shape[1], 4)),
    }
    files = ArrayFiles(folder, layouts)
    for one in progress(sequences, label="sequences"):
        garment = one.garment()
        _refuse_unfinite(output, one, garment)
        files.append(
            points=one.points,
            labels=one.labels,
            garment=garment,
            on_body=_on_body(one, bodies[one.gender]),
            on_inexact_body=_on_body(one, bodies[one.gender], inexact=True),
        )
    files.flush()


def _check(output: Path, sequences: Sequence[GarmentSequence]) -> None:
    if not sequences:
        raise InputError(f"{output}: no sequences, expected one or more")
    first, names = sequences[0], set()
    for one in sequences:
        if one.name in names:
            raise InputError(f"{output}: two sequences are named {one.name}, expected one")
        names.add(one.name)
        for key in ("points", "canonical"):
            rows, expected = (getattr(x, key).shape[-2] for x in (one, first))
            if rows != expected:
                raise InputError(
                    f"{output}: sequence {one.name} has {key} of {rows} rows, expected"
                    f" {expected} as in sequence {first.name}"
                )


def _on_body(one: GarmentSequence, body: BodyModel, *, inexact: bool = False) -> np.ndarray:
    """(T, P, 4) what `body_relative_points` adds, for the body as rounded in the files."""
    shape, poses = (np.asarray(x, dtype=np.float32) for x in (one.shape, one.poses))
    points = one.points
    if inexact:
        rng = rng_for(0, "inexact body", one.name)
        share = rng.random()
        poses = poses + rng.normal(0, share * _POSE_NOISE_RAD, poses.shape[1])
        shape = shape + rng.normal(0, share * _SHAPE_NOISE, len(shape))
        points = points + rng.normal(0, share * _ROOT_NOISE_M, 3)
    return body_relative_points(body, shape, poses, points)[..., 3:]


def _refuse_unfinite(output: Path, one: GarmentSequence, posed: np.ndarray) -> None:
    finite = np.isfinite(posed).all(axis=(1, 2)) & np.isfinite(one.points).all(axis=(1, 2))
    if not finite.all():
        raise InputError(
            f"{output}: sequence {one.name} holds NaN or infinity in frame"
            f" {int(one.number[np.argmin(finite)])}, expected metres"
        )


class SequenceData:
    """All sequences of a garment type, as `collect_sequences` wrote them.

    Args:
        folder: that it wrote.

    Attributes:
        label: its code in `LABELS`.
        points, labels, garment: (F, P, 3), (F, P), (F, N, 3), memory-mapped.
        on_body, on_inexact_body: (F, P, 4) places of points on the body and on one that is off, the
            last columns of `body_relative_points`, memory-mapped.
        poses, trans: (F, 72) and (F, 3) of the root joint in the world.
        number: (F,) of the frames in the motion.
        name, source, split, clip, start, count: (S,) of the sequences; start is their first row.
        shape, gender: (S, 10) and (S,) "female" or "male".
        canonical, coefficients: (S, N, 3), (S, D).

    Raises:
        InputError: a file is missing, lacks an array, or the arrays do not agree in length.
    """

    def __init__(self, folder: str | Path) -> None:
        folder = Path(folder)
        self.garment_type = read_json(folder / "about.json", {"garment": GARMENTS})["garment"]
        self.label = LABELS.index(self.garment_type)
        self.space = load_space(folder / "space.npz")
        arrays = open_arrays(folder, _ARRAYS, n=len(self.space.mean))
        self.points, self.labels, self.garment = (
            arrays[key] for key in ("points", "labels", "garment")
        )
        self.on_body, self.on_inexact_body = arrays["on_body"], arrays["on_inexact_body"]
        frames = load_npz(
            folder / "frames.npz",
            {"poses": "float f 72", "trans": "float f 3", "sequence": "int f", "number": "int f"},
        )
        self.poses, self.trans, self.number = (frames[key] for key in ("poses", "trans", "number"))
        components, vertices, _ = self.space.components.shape
        table = load_npz(folder / "sequences.npz", _PER_SEQUENCE, n=vertices, d=components)
        self.name, self.source, self.split = (table[key] for key in ("name", "source", "split"))
        self.clip = table["clip"]
        self.start, self.count = table["start"], table["count"]
        self.shape, self.gender = table["shape"], gender_names(table["gender"])
        self.canonical, self.coefficients = table["canonical"], table["coefficients"]
        if not np.array_equal(self.start, np.cumsum(self.count) - self.count):
            raise InputError(
                f"{folder / 'sequences.npz'}: starts of sequences do not follow from their counts"
            )
        lengths = {len(x) for x in (self.points, self.labels, self.garment, self.poses)}
        if lengths != {int(self.count.sum())}:
            raise InputError(
                f"{folder}: arrays of {', '.join(map(str, sorted(lengths)))} frames, expected"
                f" {int(self.count.sum())} as in sequences.npz"
            )
        self._folder = folder

    def __len__(self) -> int:
        return len(self.name)

    def arrays(self) -> dict[str, np.ndarray]:
        """Every array by name, for a digest of the data."""
        keys = (*_ARRAYS, "poses", "trans", "number", *_PER_SEQUENCE)
        own = {key: getattr(self, key) for key in keys}
        return own | {f"space/{key}": value for key, value in vars(self.space).items()}

    def rows(self, sequence: int) -> slice:
        """Frames of a sequence."""
        start = int(self.start[sequence])
        return slice(start, start + int(self.count[sequence]))

    def of_split(self, split: str, kinds: Sequence[str] = KINDS) -> np.ndarray:
        """Sequences of a split that are of some `KINDS`."""
        kind = np.where(self.source == SKINNED, SKINNED, SIMULATED)
        return np.flatnonzero((self.split == split) & np.isin(kind, kinds))

    @cached_property
    def originals(self) -> dict[str, Mesh]:
        """Name of a sequence -> canonical garment before registration; none for training."""
        arrays = load_npz(
            self._folder / "originals.npz", {"*/vertices": "float * 3", "*/faces": "int * 3"}
        )
        names = dict.fromkeys(key.rpartition("/")[0] for key in arrays)
        return {name: Mesh(arrays[f"{name}/vertices"], arrays[f"{name}/faces"]) for name in names}

    def windows(
        self, split: str, frames: int, stride: int, kinds: Sequence[str] = KINDS
    ) -> np.ndarray:
        """(W, 2) sequence and first frame within it of windows that cover every frame.

        Raises:
            InputError: see `window_starts`.
        """
        windows = [
            (sequence, start)
            for sequence in self.of_split(split, kinds)
            for start in window_starts(
                int(self.count[sequence]), frames, stride, str(self.name[sequence])
            )
        ]
        return np.array(windows, dtype=np.int64).reshape(-1, 2)

    def label_share(self, split: str) -> np.ndarray:
        """(L,) of the points of a split that have each of `LABELS`.

        Raises:
            InputError: a point has another label.
        """
        counts = [self.count_labels(sequence) for sequence in self.of_split(split)]
        count = np.sum(counts, axis=0) if counts else np.zeros(len(LABELS))
        return count / max(count.sum(), 1)

    def count_labels(self, sequence: int) -> np.ndarray:
        """(L,) points of a sequence that have each of `LABELS`.

        Raises:
            InputError: a point has another label.
        """
        count = np.bincount(self.labels[self.rows(sequence)].ravel(), minlength=len(LABELS))
        if len(count) > len(LABELS):
            raise InputError(
                f"{self._folder / 'labels.npy'}: holds label {len(count) - 1},"
                f" expected 0 to {len(LABELS) - 1}"
            )
        return count
