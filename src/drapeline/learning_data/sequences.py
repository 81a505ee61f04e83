"""Clouds through sequences, and garments of one type in them, as arrays that are memory-mapped.

All coordinates are metres relative to the root joint, Z up. Motions have 30 frames per second; a
simulated sequence has all of its frames, a skinned one a few of them. F frames of all sequences, S
sequences, P points of a cloud, N vertices of the template, T frames of a window, D components of
the garment space.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.dataset.windows import window_starts
from drapeline.errors import InputError
from drapeline.frames import GENDERS, gender_names
from drapeline.geometry.mesh import Mesh
from drapeline.learning_data.body_relative_points import body_relative_points
from drapeline.learning_data.worse_inputs import worse_body, worse_clouds
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
_OF_CLOUDS = {
    "points": "float f p 3",
    "labels": "int f p",
    "on_body": "float f p 4",
}
_OF_WORSE_CLOUDS = {
    "worse_points": "float f p 3",
    "worse_labels": "int f p",
    "on_worse_body": "float f p 4",
}
_OF_SEQUENCES = {
    **dict.fromkeys(("name", "source", "split", "clip"), "str s"),
    **dict.fromkeys(("start", "count"), "int s"),
}
_OF_GARMENTS = {
    "shape": "float s 10",
    "gender": f"int<{len(GENDERS)} s",
    "canonical": "float s n 3",
    "coefficients": "float s d",
}


@dataclass(frozen=True)
class SeenSequence:
    """Somebody through one sequence, before it is collected."""

    name: str  # of the sequence; no other has it
    source: str  # the cloth solver that moved the garments, or `SKINNED` where weights did
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


@dataclass(frozen=True)
class GarmentSequence(SeenSequence):
    """The same with a garment."""

    canonical: np.ndarray  # (N, 3) the garment in the rest pose, in template topology
    original: Mesh  # the same before registration, triangles
    # Gives (T, N, 3), the posed garment in template topology, when it is needed.
    garment: Callable[[], np.ndarray]


_OneSequence = TypeVar("_OneSequence", bound=SeenSequence)


def collect_clouds(
    output: str | Path, sequences: Sequence[SeenSequence], bodies: Mapping[str, BodyModel]
) -> int:
    """Write the clouds of all sequences as arrays, as they are and worse, as real scans are.

    Args:
        output: folder, replaced as a whole.
        bodies: whole, by gender.

    Returns:
        Number of frames written.

    Raises:
        InputError: two sequences have one name, or one does not fit the others.
    """
    output = Path(output)
    _check(output, sequences, ("points",))
    count = sequences[0].points.shape[1]
    with atomic_folder(output) as scratch:
        layouts = _cloud_layouts(count, *_OF_WORSE_CLOUDS)
        _write_frames(scratch, sequences, bodies, output, _worsen, **layouts)
        _write_table(scratch, sequences)
    return sum(len(one.poses) for one in sequences)


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
        bodies: whole, by gender.

    Returns:
        Number of frames written.

    Raises:
        InputError: there are fewer than two training sequences, two sequences have one name, or
            one does not fit the others.
    """
    output = Path(output)
    _check(output, sequences, ("points", "canonical"))
    canonical = np.stack([one.canonical for one in sequences]).astype(np.float32)
    trained = np.array([one.split == "train" for one in sequences])
    space = fit_space(canonical[trained], components, faces)
    counts = [len(one.poses) for one in sequences]
    with atomic_folder(output) as scratch:
        _write_frames(
            scratch,
            sequences,
            bodies,
            output,
            lambda one, _: {"garment": one.garment()},
            garment=(np.float32, canonical.shape[1:]),
        )
        save_npz(
            scratch / "frames.npz",
            poses=np.concatenate([one.poses for one in sequences]).astype(np.float32),
            trans=np.concatenate([one.trans for one in sequences]).astype(np.float32),
            sequence=np.repeat(np.arange(len(sequences)), counts),
            number=np.concatenate([one.number for one in sequences]),
        )
        _write_table(
            scratch,
            sequences,
            canonical=canonical,
            coefficients=space.coefficients(canonical),
            shape=np.stack([one.shape for one in sequences]).astype(np.float32),
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
    return sum(counts)


def _write_table(folder: Path, sequences: Sequence[SeenSequence], **of_garments: Any) -> None:
    counts = np.array([len(one.poses) for one in sequences])
    save_npz(
        folder / "sequences.npz",
        start=np.cumsum(counts) - counts,
        count=counts,
        **{
            key: np.array([getattr(one, key) for one in sequences])
            for key in ("name", "source", "split", "clip")
        },
        **of_garments,
    )


def _write_frames(
    folder: Path,
    sequences: Sequence[_OneSequence],
    bodies: Mapping[str, BodyModel],
    output: Path,
    more: Callable[[_OneSequence, BodyModel], dict[str, np.ndarray]],
    **layouts: tuple[type, tuple[int, ...]],
) -> None:
    """Write the arrays with a row per frame, one sequence at a time.

    Args:
        output: for errors.
        more: arrays of a sequence besides its clouds.
        layouts: types of these and shapes of their rows, by name.
    """
    count, total = sequences[0].points.shape[1], sum(len(one.poses) for one in sequences)
    # Computing places on the body takes longer than an epoch of training.
    layouts |= _cloud_layouts(count, "points", "labels", "on_body")
    files = ArrayFiles(folder, {key: (kind, (total, *row)) for key, (kind, row) in layouts.items()})
    for one in progress(sequences, label="sequences"):
        _refuse_unfinite(output, one, one.points)
        body = bodies[one.gender]
        others = more(one, body)
        for array in others.values():
            _refuse_unfinite(output, one, array)
        on_body = body_relative_points(body, *_rounded(one), one.points)[..., 3:]
        files.append(points=one.points, labels=one.labels, on_body=on_body, **others)
    files.flush()


def _cloud_layouts(
    count: int, points: str, labels: str, places: str
) -> dict[str, tuple[type, tuple[int, ...]]]:
    return {
        points: (np.float32, (count, 3)),
        labels: (np.uint8, (count,)),
        places: (np.float32, (count, 4)),
    }


def _rounded(one: SeenSequence) -> tuple[np.ndarray, np.ndarray]:
    """Shape and poses of the body as they are in the files."""
    return np.asarray(one.shape, dtype=np.float32), np.asarray(one.poses, dtype=np.float32)


def _worsen(one: SeenSequence, body: BodyModel) -> dict[str, np.ndarray]:
    """The arrays of `_OF_WORSE_CLOUDS`."""
    rng = rng_for(0, "worse inputs", one.name)
    points, labels = worse_clouds(one.points, one.labels, rng)
    places = body_relative_points(body, *worse_body(*_rounded(one), points, rng))[..., 3:]
    return dict(zip(_OF_WORSE_CLOUDS, (points, labels, places), strict=True))


def _check(output: Path, sequences: Sequence[SeenSequence], same: Sequence[str]) -> None:
    """Refuse two sequences of one name, and arrays of other than the `same` number of rows."""
    if not sequences:
        raise InputError(f"{output}: no sequences, expected one or more")
    first, names = sequences[0], set()
    for one in sequences:
        if one.name in names:
            raise InputError(f"{output}: two sequences are named {one.name}, expected one")
        names.add(one.name)
        for key in same:
            rows, expected = (getattr(x, key).shape[-2] for x in (one, first))
            if rows != expected:
                raise InputError(
                    f"{output}: sequence {one.name} has {key} of {rows} rows, expected"
                    f" {expected} as in sequence {first.name}"
                )


def _refuse_unfinite(output: Path, one: SeenSequence, array: np.ndarray) -> None:
    finite = np.isfinite(array).reshape(len(array), -1).all(axis=1)
    if not finite.all():
        raise InputError(
            f"{output}: sequence {one.name} holds NaN or infinity in frame"
            f" {int(one.number[np.argmin(finite)])}, expected metres"
        )


class SequenceClouds:
    """Clouds of sequences in the arrays of a folder.

    Args:
        folder: with `sequences.npz`, and an array for each key of `_of_frames`.

    Attributes:
        points, labels: (F, P, 3) and (F, P), memory-mapped.
        on_body: (F, P, 4) places of points on the body, the last columns of
            `body_relative_points`, memory-mapped.
        name, source, split, clip, start, count: (S,) of the sequences; start is their first row.

    Raises:
        InputError: a file is missing, lacks an array, or the arrays do not agree in length.
    """

    points: np.ndarray
    labels: np.ndarray
    on_body: np.ndarray
    name: np.ndarray
    source: np.ndarray
    split: np.ndarray
    clip: np.ndarray
    start: np.ndarray
    count: np.ndarray

    _of_frames: ClassVar[Mapping[str, str]] = _OF_CLOUDS
    _of_sequences: ClassVar[Mapping[str, str]] = _OF_SEQUENCES

    def __init__(self, folder: str | Path, **lengths: int) -> None:
        self._folder = Path(folder)
        arrays = open_arrays(self._folder, self._of_frames, **lengths)
        table = load_npz(self._folder / "sequences.npz", self._of_sequences, unread=(), **lengths)
        for key, value in (arrays | table).items():
            setattr(self, key, value)
        if not np.array_equal(self.start, np.cumsum(self.count) - self.count):
            raise InputError(
                f"{self._folder / 'sequences.npz'}: starts of sequences do not follow from their"
                " counts"
            )
        self._require_frames(*arrays.values())

    def _require_frames(self, *arrays: np.ndarray) -> None:
        lengths = {len(array) for array in arrays}
        if lengths != {int(self.count.sum())}:
            raise InputError(
                f"{self._folder}: arrays of {', '.join(map(str, sorted(lengths)))} frames, expected"
                f" {int(self.count.sum())} as in sequences.npz"
            )

    def __len__(self) -> int:
        return len(self.name)

    def arrays(self) -> dict[str, np.ndarray]:
        """Every array by name, for a digest of the data."""
        return {key: getattr(self, key) for key in (*self._of_frames, *self._of_sequences)}

    def rows(self, sequence: int) -> slice:
        """Frames of a sequence."""
        start = int(self.start[sequence])
        return slice(start, start + int(self.count[sequence]))

    def of_split(self, split: str, kinds: Sequence[str] = KINDS) -> np.ndarray:
        """Sequences of a split that are of some `KINDS`."""
        kind = np.where(self.source == SKINNED, SKINNED, SIMULATED)
        return np.flatnonzero((self.split == split) & np.isin(kind, kinds))

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

    def label_share(self, split: str, kinds: Sequence[str] = KINDS) -> np.ndarray:
        """(L,) of the points of a split that have each of `LABELS`.

        Raises:
            InputError: a point has another label.
        """
        count = np.zeros(len(LABELS))
        for sequence in self.of_split(split, kinds):
            found = np.bincount(self.labels[self.rows(sequence)].ravel(), minlength=len(LABELS))
            if len(found) > len(LABELS):
                raise InputError(
                    f"{self._folder / 'labels.npy'}: holds label {len(found) - 1},"
                    f" expected 0 to {len(LABELS) - 1}"
                )
            count += found
        return count / max(count.sum(), 1)


class CloudData(SequenceClouds):
    """Clouds of all sequences, as `collect_clouds` wrote them; see `SequenceClouds`.

    Args:
        folder: that it wrote.

    Attributes:
        worse_points, worse_labels: of the worse clouds, see `worse_clouds`, memory-mapped.
        on_worse_body: (F, P, 4) of those on a body that is off, see `worse_body`, memory-mapped.

    Raises:
        InputError: a file is missing, lacks an array, or the arrays do not agree in length.
    """

    worse_points: np.ndarray
    worse_labels: np.ndarray
    on_worse_body: np.ndarray
    _of_frames = _OF_CLOUDS | _OF_WORSE_CLOUDS

    def rows_of(self, name: str) -> slice:
        """Frames of a sequence, by its name.

        Raises:
            InputError: there is none.
        """
        if name not in self._places:
            raise InputError(f"{self._folder}: has no sequence {name}, expected one")
        return self.rows(self._places[name])

    @cached_property
    def _places(self) -> dict[str, int]:
        return {str(name): place for place, name in enumerate(self.name)}


class SequenceData(SequenceClouds):
    """All sequences of a garment type, as `collect_sequences` wrote them; see `SequenceClouds`.

    Args:
        folder: that it wrote.

    Attributes:
        garment_type, label: the type, and its code in `LABELS`.
        space: of its shapes at rest.
        garment: (F, N, 3), memory-mapped.
        poses, trans: (F, 72) and (F, 3) of the root joint in the world.
        number: (F,) of the frames in the motion.
        shape, gender: (S, 10) and (S,) "female" or "male".
        canonical, coefficients: (S, N, 3), (S, D).

    Raises:
        InputError: a file is missing, lacks an array, or the arrays do not agree in length.
    """

    garment: np.ndarray
    shape: np.ndarray
    gender: np.ndarray
    canonical: np.ndarray
    coefficients: np.ndarray
    _of_frames = _OF_CLOUDS | {"garment": "float f n 3"}
    _of_sequences = _OF_SEQUENCES | _OF_GARMENTS

    def __init__(self, folder: str | Path) -> None:
        folder = Path(folder)
        self.garment_type = read_json(folder / "about.json", {"garment": GARMENTS})["garment"]
        self.label = LABELS.index(self.garment_type)
        self.space = load_space(folder / "space.npz")
        components, vertices, _ = self.space.components.shape
        super().__init__(folder, n=vertices, d=components)
        self.gender = gender_names(self.gender)
        frames = load_npz(
            folder / "frames.npz",
            {"poses": "float f 72", "trans": "float f 3", "sequence": "int f", "number": "int f"},
        )
        self.poses, self.trans, self.number = (frames[key] for key in ("poses", "trans", "number"))
        self._require_frames(self.poses)

    def arrays(self) -> dict[str, np.ndarray]:
        """Every array by name, for a digest of the data."""
        frames = {key: getattr(self, key) for key in ("poses", "trans", "number")}
        space = {f"space/{key}": value for key, value in vars(self.space).items()}
        return super().arrays() | frames | space

    @cached_property
    def originals(self) -> dict[str, Mesh]:
        """Name of a sequence -> canonical garment before registration; none for training."""
        arrays = load_npz(
            self._folder / "originals.npz", {"*/vertices": "float * 3", "*/faces": "int * 3"}
        )
        names = dict.fromkeys(key.rpartition("/")[0] for key in arrays)
        return {name: Mesh(arrays[f"{name}/vertices"], arrays[f"{name}/faces"]) for name in names}
