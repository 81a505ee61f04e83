"""Sequences of one garment type for Garment4D: collected into arrays that are mapped, in windows.

All coordinates are metres relative to the root joint, Z up. Motions have 30 frames per second; a
simulated sequence has all of its frames, a skinned one a few of them. F frames of all sequences, S
sequences, P points of a cloud, N vertices of the template, M body vertices that networks see, T
frames of a window, D components of the garment space.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from drapeline.dataset.labels import LABELS
from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.models.garment4d.body_input import BodySet, PosedBody, SkinningSettings, proposals
from drapeline.registration.to_template.garment_space import fit_space, load_space
from drapeline.rule_log import LOGGER, progress
from drapeline.storage import (
    atomic_folder,
    create_array,
    load_npz,
    open_array,
    read_json,
    save_npz,
    write_json,
)

SOURCES = ("simulated", "skinned")
_PER_SEQUENCE = ("name", "source", "split", "start", "count", "shape", "gender", "canonical")
_KEPT_BYTES = 512 << 20  # of bodies, and of weights, each
_VALIDATED = 3  # windows per sequence of the canonical stage: all have one true garment
_KEPT_WEARERS = 512  # of some hundred kilobytes each


@dataclass(frozen=True)
class GarmentSequence:
    """One garment through one sequence, before it is collected.

    Attributes:
        name: of the sequence; no other of the same type has it.
        source: "simulated", or "skinned" for a garment moved by its skinning weights.
        split: "train", "val" or "test".
        gender: 0 female, 1 male.
        shape: (10,).
        poses: (T, 72) rad.
        number: (T,) of the frames in the motion, rising; those of skinned sequences may be some
            frames apart.
        points: (T, P, 3) clouds.
        labels: (T, P) codes of `LABELS`.
        canonical: (N, 3) the garment in the rest pose, in template topology.
        original: the same before registration, triangles.
        garment: gives (T, N, 3), the posed garment in template topology, when it is needed.
    """

    name: str
    source: str
    split: str
    gender: int
    shape: np.ndarray
    poses: np.ndarray
    number: np.ndarray
    points: np.ndarray
    labels: np.ndarray
    canonical: np.ndarray
    original: Mesh
    garment: Callable[[], np.ndarray]


def collect_garment4d(
    output: str | Path,
    garment: str,
    sequences: Sequence[GarmentSequence],
    faces: np.ndarray,
    components: int,
    wearers: BodySet | None = None,
) -> int:
    """Write all sequences of one type as arrays, and the shape space of those for training.

    Args:
        output: folder, replaced as a whole.
        garment: the type.
        sequences: any number of any splits.
        faces: (F, 3) of the type's template.
        components: D of the space; fewer where there are few garments.
        wearers: the bodies, to say where on them points are; None if no network asks for it.

    Returns:
        Number of frames written.

    Raises:
        InputError: there are fewer than two training sequences, two sequences have one name, or
            one does not fit the others.
    """
    output = Path(output)
    _check(output, sequences)
    counts = np.array([len(one.poses) for one in sequences])
    total, first = int(counts.sum()), sequences[0]
    canonical = np.stack([one.canonical for one in sequences]).astype(np.float32)
    trained = np.array([one.split == "train" for one in sequences])
    space = fit_space(canonical[trained], components, faces)
    kinds = [
        ("points", np.float32, first.points.shape[1:]),
        ("labels", np.uint8, first.labels.shape[1:]),
        ("garment", np.float32, first.canonical.shape),
        # Five jobs read what takes longer to find than to train on once.
        *([("body_relative_points", np.float32, (first.points.shape[1], 4))] if wearers else []),
    ]
    with atomic_folder(output) as scratch:
        arrays = {
            name: create_array(scratch / f"{name}.npy", dtype, (total, *shape))
            for name, dtype, shape in kinds
        }
        starts = np.cumsum(counts) - counts
        for one, start in progress(
            zip(sequences, starts, strict=True), total=len(sequences), label="sequences"
        ):
            posed = one.garment()
            _refuse_unfinite(output, one, posed)
            values = {"points": one.points, "labels": one.labels, "garment": posed}
            if wearers:
                values["body_relative_points"] = _body_relative_points(one, wearers)
            for name, value in values.items():
                arrays[name][start : start + len(one.poses)] = value
        for array in arrays.values():
            array.flush()
        save_npz(
            scratch / "frames.npz",
            poses=np.concatenate([one.poses for one in sequences]).astype(np.float32),
            sequence=np.repeat(np.arange(len(sequences)), counts),
            number=np.concatenate([one.number for one in sequences]),
        )
        save_npz(
            scratch / "sequences.npz",
            start=starts,
            count=counts,
            canonical=canonical,
            coefficients=space.coefficients(canonical),
            shape=np.stack([one.shape for one in sequences]).astype(np.float32),
            **{
                key: np.array([getattr(one, key) for one in sequences])
                for key in ("name", "source", "split", "gender")
            },
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
    return total


def _check(output: Path, sequences: Sequence[GarmentSequence]) -> None:
    if not sequences:
        raise InputError(f"{output}: no sequences, expected one or more")
    first, names = sequences[0], set()
    for one in sequences:
        if one.name in names:
            raise InputError(f"{output}: two sequences are named {one.name}, expected one")
        names.add(one.name)
        for key in ("points", "canonical"):
            found, wanted = (getattr(x, key).shape[-2] for x in (one, first))
            if found != wanted:
                raise InputError(
                    f"{output}: sequence {one.name} has {key} of {found} rows, expected"
                    f" {wanted} as in sequence {first.name}"
                )


def _body_relative_points(one: GarmentSequence, wearers: BodySet) -> np.ndarray:
    """(T, P, 4) what `PosedBody.body_relative_points` adds, with the body rounded as when read."""
    shape, poses = (np.asarray(x, dtype=np.float32) for x in (one.shape, one.poses))
    return wearers.of(one.gender, shape).body_relative_points(one.points, poses)[..., 3:]


def _refuse_unfinite(output: Path, one: GarmentSequence, posed: np.ndarray) -> None:
    finite = np.isfinite(posed).all(axis=(1, 2)) & np.isfinite(one.points).all(axis=(1, 2))
    if not finite.all():
        raise InputError(
            f"{output}: sequence {one.name} holds NaN or infinity in frame"
            f" {int(one.number[np.argmin(finite)])}, expected metres"
        )


class SequenceData:
    """What `collect_garment4d` wrote.

    Args:
        folder: it wrote.
        wearers: the bodies.

    Attributes:
        kind: garment type.
        label: its code in `LABELS`.
        space: of canonical garments.
        points, labels, garment: (F, P, 3), (F, P), (F, N, 3), memory-mapped.
        poses, number: (F, 72) and (F,) frame numbers in the motion.
        name, source, split, start, count: (S,) of the sequences; start is their first row.
        shape, gender: (S, 10), (S,).
        canonical, coefficients: (S, N, 3), (S, D).
        worn: (S, N, 3) canonical garments that proposals are skinned from; the true ones at first.

    Raises:
        InputError: a file is missing, lacks an array, or the arrays do not agree in length.
    """

    def __init__(self, folder: str | Path, wearers: BodySet) -> None:
        folder = Path(folder)
        self.kind = str(read_json(folder / "about.json")["garment"])
        self.label = LABELS.index(self.kind)
        self.space = load_space(folder / "space.npz")
        self.points, self.labels, self.garment = (
            open_array(folder / f"{key}.npy") for key in ("points", "labels", "garment")
        )
        frames = load_npz(folder / "frames.npz", "poses", "sequence", "number")
        self.poses, self.number = frames["poses"], frames["number"]
        sequences = load_npz(folder / "sequences.npz", *_PER_SEQUENCE, "coefficients")
        for key, value in sequences.items():
            setattr(self, key, value)
        lengths = {len(x) for x in (self.points, self.labels, self.garment, self.poses)}
        if lengths != {int(self.count.sum())}:
            raise InputError(
                f"{folder}: arrays of {', '.join(map(str, sorted(lengths)))} frames, expected"
                f" {int(self.count.sum())} as in sequences.npz"
            )
        self._folder = folder
        self.wearers = wearers
        self.wear(self.canonical, SkinningSettings())

    def wear(self, canonical: np.ndarray, skinning: SkinningSettings) -> None:
        """Skin proposals from these canonical garments (S, N, 3) in this way from now on."""
        self.worn, self.skinning = canonical, skinning
        weights_bytes = 4 * 24 * canonical.shape[1]
        self._weights = lru_cache(max(_KEPT_BYTES // weights_bytes, 1))(self._weights_of)
        self._shown = _Kept(self._shown_of, _KEPT_BYTES)
        self._wearer = lru_cache(_KEPT_WEARERS)(self._wearer_of)

    def __len__(self) -> int:
        return len(self.name)

    def arrays(self) -> dict[str, np.ndarray]:
        """All that a training depends on, by name; the bodies included."""
        keys = ("points", "labels", "garment", "poses", "number", *_PER_SEQUENCE, "coefficients")
        own = {key: getattr(self, key) for key in keys}
        space = {f"space/{key}": value for key, value in vars(self.space).items()}
        bodies = {f"bodies/{key}": value for key, value in self.wearers.arrays().items()}
        return own | space | bodies

    def rows(self, sequence: int) -> slice:
        """Frames of a sequence."""
        start = int(self.start[sequence])
        return slice(start, start + int(self.count[sequence]))

    def consecutive(self, sequence: int) -> bool:
        """Whether a sequence has every frame of its motion, so that accelerations are known."""
        return bool((np.diff(self.number[self.rows(sequence)]) == 1).all())

    def of_split(self, split: str, sources: Sequence[str] = SOURCES) -> np.ndarray:
        """Sequences of a split from some sources."""
        return np.flatnonzero((self.split == split) & np.isin(self.source, sources))

    @cached_property
    def originals(self) -> dict[str, Mesh]:
        """Name of a sequence -> canonical garment before registration; none for training."""
        arrays = load_npz(self._folder / "originals.npz")
        names = dict.fromkeys(key.rpartition("/")[0] for key in arrays)
        return {name: Mesh(arrays[f"{name}/vertices"], arrays[f"{name}/faces"]) for name in names}

    def wearer(self, sequence: int) -> PosedBody:
        """Who wears a sequence's garment."""
        return self._wearer(int(sequence))

    def weights(self, sequence: int) -> np.ndarray:
        """(N, 24) float32 skinning weights of the garment worn."""
        return self._weights(int(sequence))

    def _wearer_of(self, sequence: int) -> PosedBody:
        return self.wearers.of(int(self.gender[sequence]), self.shape[sequence])

    def _weights_of(self, sequence: int) -> np.ndarray:
        wearer = self.wearer(sequence)
        return wearer.weights(self.worn[sequence], self.space.faces, self.skinning)

    def _shown_of(self, sequence: int, rows: slice) -> tuple[np.ndarray, ...]:
        wearer, poses = self.wearer(sequence), self.poses[rows]
        return *wearer.shown(poses), wearer.transforms(poses)

    def windows(
        self, split: str, frames: int, stride: int, sources: Sequence[str] = SOURCES
    ) -> np.ndarray:
        """(W, 2) sequence and first frame within it of windows that cover every frame.

        Raises:
            InputError: see `window_starts`.
        """
        found = [
            (sequence, start)
            for sequence in self.of_split(split, sources)
            for start in window_starts(
                int(self.count[sequence]), frames, stride, str(self.name[sequence])
            )
        ]
        return np.array(found, dtype=np.int64).reshape(-1, 2)

    def label_share(self, split: str) -> np.ndarray:
        """(L,) of the points of a split that have each of `LABELS`."""
        count = np.zeros(len(LABELS), dtype=np.int64)
        for sequence in self.of_split(split):
            count += np.bincount(self.labels[self.rows(sequence)].ravel(), minlength=len(LABELS))
        return count / max(count.sum(), 1)

    def clouds(
        self, sequence: int, *, body_relative_points: bool, frames: slice = slice(None)
    ) -> np.ndarray:
        """(F, P, 3) points of frames of a sequence; (F, P, 7) if relative to the body as well."""
        rows = self.rows(sequence)
        points = self.points[rows][frames]
        if not body_relative_points:
            return points
        return np.concatenate([points, self._body_relative_points[rows][frames]], axis=-1)

    @cached_property
    def _body_relative_points(self) -> np.ndarray:
        return open_array(self._folder / "body_relative_points.npy")

    def batch(
        self, windows: np.ndarray, frames: int, *, posed: bool, body_relative_points: bool = False
    ) -> dict[str, Any]:
        """Arrays of windows.

        Args:
            windows: (B, 2) as from `windows`.
            frames: T.
            posed: whether what only the posed stage needs is wanted too.
            body_relative_points: whether points also say where on the body they are.

        Returns:
            `points` (B, T, P, 3 or 7), `labels` (B, T, P) int64, `canonical` (B, N, 3),
            `coefficients` (B, D), `rest_body` and `rest_normals` (B, M, 3), `names`, `sequence` and
            `start` (B,), the windows; and if posed `target` (B, T, N, 3), `poses` (B, T, 72),
            `body` and `body_normals` (B, T, M, 3), `transforms` (B, T, 24, 4, 4), `worn` (B, N, 3),
            `weights` (B, N, 24) and `proposal` (B, T, N, 3).
        """
        places = [(int(s), slice(int(first), int(first) + frames)) for s, first in windows]
        starts = [int(self.start[s]) + part.start for s, part in places]
        spans = [slice(row, row + frames) for row in starts]
        chosen = np.array([s for s, _ in places])
        rest = [self.wearer(s).rest for s in chosen]
        batch = {
            "points": np.stack(
                [
                    self.clouds(s, body_relative_points=body_relative_points, frames=part)
                    for s, part in places
                ]
            ),
            "labels": np.stack([self.labels[span] for span in spans]).astype(np.int64),
            "canonical": self.canonical[chosen],
            "coefficients": self.coefficients[chosen].astype(np.float32),
            "rest_body": np.stack([vertices for vertices, _ in rest]).astype(np.float32),
            "rest_normals": np.stack([normals for _, normals in rest]).astype(np.float32),
            "sequence": chosen,
            "start": np.array([part.start for _, part in places]),
            "names": [
                f"{self.name[s]}/{self.number[row]}" for s, row in zip(chosen, starts, strict=True)
            ],
        }
        if not posed:
            return batch
        shown = [self._shown(s, self.rows(s), part) for s, part in places]
        batch |= {
            key: np.stack([one[part] for one in shown]).astype(np.float32)
            for part, key in enumerate(("body", "body_normals", "transforms"))
        }
        batch |= {
            "target": np.stack([self.garment[span] for span in spans]),
            "poses": np.stack([self.poses[span] for span in spans]),
            "worn": self.worn[chosen].astype(np.float32),
            "weights": np.stack([self.weights(s) for s in chosen]),
        }
        batch["proposal"] = proposals(batch["worn"], batch["weights"], batch["transforms"])
        return batch


class _Kept:
    """Arrays over the frames of whole sequences, as long as there is room; of others parts only.

    Args:
        compute: sequence and its rows -> arrays (F, ...) of those rows.
        room: bytes.
    """

    def __init__(self, compute: Callable[[int, slice], tuple[np.ndarray, ...]], room: int) -> None:
        self._compute, self._room = compute, room
        self._found: dict[int, tuple[np.ndarray, ...]] = {}

    def __call__(self, sequence: int, rows: slice, frames: slice) -> tuple[np.ndarray, ...]:
        """Of some frames of the sequence that has these rows."""
        if sequence not in self._found:
            wanted = range(rows.start, rows.stop)[frames]
            part = self._compute(sequence, slice(wanted.start, wanted.stop))
            count = rows.stop - rows.start
            size = sum(x.nbytes for x in part) // len(wanted) * count
            if size > self._room:
                return part
            self._room -= size
            whole = len(wanted) == count
            self._found[sequence] = part if whole else self._compute(sequence, rows)
        return tuple(x[frames] for x in self._found[sequence])


def _evenly(windows: np.ndarray) -> np.ndarray:
    """At most `_VALIDATED` of the windows (W, 2) of one sequence, evenly spread."""
    count = min(_VALIDATED, len(windows))
    return windows[np.linspace(0, len(windows) - 1, count).round().astype(int)]


def window_starts(count: int, frames: int, stride: int, name: str) -> list[int]:
    """First frames of windows; the last one is shifted back to end with the sequence, not padded.

    Args:
        count: frames of the sequence.
        frames: T.
        stride: from one window to the next, at most T.
        name: of the sequence, for the error.

    Raises:
        InputError: the sequence is shorter than a window, or windows would leave out frames.
    """
    if count < frames:
        raise InputError(f"sequence {name} has {count} frames, expected at least {frames}")
    if stride > frames:
        raise InputError(
            f"sequence {name}: windows of {frames} frames have a stride of {stride}, expected at"
            f" most {frames}"
        )
    starts = list(range(0, count - frames + 1, stride))
    return starts if starts[-1] == count - frames else [*starts, count - frames]


class Windows:
    """Windows of all splits as rows, for training.

    Where the validation split holds no sequence of the sources asked for it gives those of any
    source: a network must be selected by something that it was not trained on.

    Args:
        data: sequences.
        frames: T.
        stride: from one training window to the next; validation windows do not overlap, and there
            are a few of each sequence if only the canonical garment is looked for, lest the longest
            sequences decide alone.
        sources: of the sequences.
        posed: whether batches are for the posed stage.
        body_relative_points: whether points also say where on the body they are.
    """

    def __init__(
        self,
        data: SequenceData,
        *,
        frames: int,
        stride: int,
        sources: Sequence[str] = SOURCES,
        posed: bool,
        body_relative_points: bool = False,
    ) -> None:
        self.data, self.frames, self.posed, self.body_relative_points = (
            data,
            frames,
            posed,
            body_relative_points,
        )
        train = data.windows("train", frames, stride, sources)
        val = self._validated(sources)
        if not len(val):
            val = self._validated(SOURCES)
            LOGGER.warning(
                "no %s %s in the validation split: the network is selected on %d windows of others",
                " or ".join(sources),
                data.kind,
                len(val),
            )
        self._windows = np.concatenate([train, val])
        self._rows = {
            "train": np.arange(len(train)),
            "val": np.arange(len(train), len(self._windows)),
        }

    def __len__(self) -> int:
        return len(self._windows)

    def _validated(self, sources: Sequence[str]) -> np.ndarray:
        val = self.data.windows("val", self.frames, self.frames, sources)
        if self.posed or not len(val):
            return val
        return np.concatenate([_evenly(val[val[:, 0] == s]) for s in np.unique(val[:, 0])])

    def rows(self, split: str) -> np.ndarray:
        """Rows of "train" or "val"."""
        return self._rows[split]

    def topology(self, rows: np.ndarray) -> np.ndarray:
        """(n,) zeros: all windows are of one type."""
        return np.zeros(len(rows), dtype=np.int64)

    def batch(self, rows: np.ndarray) -> dict[str, Any]:
        """See `SequenceData.batch`."""
        return self.data.batch(
            self._windows[rows],
            self.frames,
            posed=self.posed,
            body_relative_points=self.body_relative_points,
        )
