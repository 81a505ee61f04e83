"""Inputs of the networks: windows of clouds, the bodies in them and the garments they wear.

All coordinates are metres relative to the root joint, Z up. S sequences, F frames, P points of a
cloud, N vertices of the template, K of its springs, M body vertices that networks are given, T
frames of a window, D components of the garment space.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import torch
from scipy import sparse

from drapeline.bodies.kinematics import skin_body
from drapeline.bodies.model import BodyModel, shape_body
from drapeline.bodies.rest_body import rest_body
from drapeline.bodies.weight_transfer import interpolated_weights
from drapeline.dataset.windows import window_starts
from drapeline.frames import GENDERS, REST_POSE
from drapeline.learning_data.body_relative_points import joint_transforms
from drapeline.learning_data.sequences import KINDS, SequenceData
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.models.layers.linear import linear_blend_skinning
from drapeline.models.layers.point_search import farthest_points
from drapeline.models.training.batches import ByteCache, count_bytes
from drapeline.rule_log import LOGGER

_KEPT_BODIES = 512  # of some hundred kilobytes each
_KEPT_BYTES = 512 << 20  # of bodies in motion, and of skinning weights, each
_WINDOWS = 4  # at once, where no gradient is wanted


class SurfaceSample:
    """Fixed vertices (M,) of a body with the exact normals of the whole body there."""

    def __init__(self, body: BodyModel, chosen: np.ndarray) -> None:
        faces = body.faces[np.isin(body.faces, chosen).any(axis=1)]
        self._used, places = np.unique(np.r_[faces.ravel(), chosen], return_inverse=True)
        self._corners = places[: faces.size].reshape(faces.shape)
        self._chosen = places[faces.size :]
        self.chosen = chosen
        self._body = body
        # Rows sum the area vectors of the faces about each chosen vertex.
        row = np.full(len(self._used), -1)
        row[self._chosen] = np.arange(len(chosen))
        rows, column = row[self._corners].ravel(), np.repeat(np.arange(len(faces)), 3)
        about = rows >= 0
        self._around = sparse.csr_matrix(
            (np.ones(about.sum(), dtype=np.float32), (rows[about], column[about])),
            shape=(len(chosen), len(faces)),
        )

    def pose(self, shape: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (F, M, 3) in metres and unit normals (F, M, 3) for poses (F, 72) in rad."""
        body, used = self._body, self._used
        vertices, joints = shape_body(body, shape)
        directions = body.posedirs[used] if body.has_posedirs else None
        around, _ = skin_body(
            vertices[used] - joints[0],
            joints - joints[0],
            body.weights[used],
            np.asarray(poses, dtype=np.float32),
            directions,
        )
        a, b, c = (around[:, self._corners[:, corner]] for corner in range(3))
        area = np.cross(b - a, c - a)  # (F, K, 3)
        flat = self._around @ area.transpose(1, 0, 2).reshape(area.shape[1], -1)
        normals = flat.reshape(len(self._chosen), len(area), 3).transpose(1, 0, 2)
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
        return around[:, self._chosen], normals / np.maximum(length, 1e-20)


class ShapedBody:
    """A body of known shape in any poses.

    Args:
        model: whole, in SMPL's format.
        surface: its vertices that networks are given.
        gender: "female" or "male".
        shape: (10,).
    """

    def __init__(
        self, model: BodyModel, surface: SurfaceSample, gender: str, shape: np.ndarray
    ) -> None:
        self.model, self.surface, self.gender = model, surface, gender
        self.shape = np.asarray(shape)

    @cached_property
    def rest_surface(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (M, 3) and normals (M, 3) in the rest pose."""
        vertices, normals = self.pose_surface(REST_POSE[None])
        return vertices[0], normals[0]

    def pose_surface(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (F, M, 3) and normals (F, M, 3) float32 in poses (F, 72)."""
        return self.surface.pose(self.shape, poses)

    def transforms(self, poses: np.ndarray) -> np.ndarray:
        """(F, 24, 4, 4) float32 motions of the joints' parts from the rest pose to poses."""
        return joint_transforms(self.model, self.shape, poses)


class BodySet:
    """Bodies of both genders with the vertices of either that networks are given.

    Args:
        models: by gender; of one topology.
        count: M, vertices that networks are given: those of the mean female body that lie farthest
            apart.
    """

    def __init__(self, models: Mapping[str, BodyModel], count: int) -> None:
        first = models[GENDERS[0]]
        points = torch.from_numpy(rest_body(first, np.zeros(10)).astype(np.float32))
        chosen = farthest_points(points[None], min(count, len(points)))[0].numpy()
        self.models, self.count = models, count
        self._surfaces = {gender: SurfaceSample(model, chosen) for gender, model in models.items()}

    def arrays(self) -> dict[str, np.ndarray]:
        """Every array by name, for a digest of the bodies."""
        return {
            f"{gender}/{key}": value
            for gender, surface in self._surfaces.items()
            for key, value in {**vars(self.models[gender]), "chosen": surface.chosen}.items()
            if isinstance(value, np.ndarray)
        }

    def of(self, gender: str, shape: np.ndarray) -> ShapedBody:
        """The body of a gender and a shape (10,)."""
        return ShapedBody(self.models[gender], self._surfaces[gender], gender, shape)


class Seen(NamedTuple):
    """A sequence as models are given it; metres, root frame."""

    points: np.ndarray  # (F, P, 3)
    poses: np.ndarray  # (F, 72) rad, 30 per second
    trans: np.ndarray  # (F, 3) of the root joint in the world
    body: ShapedBody
    # (F, P) codes of `LABELS`, what each point is taken for; None where that is not known yet.
    labels: np.ndarray | None = None

    def taken_for(self, label: int) -> np.ndarray:
        """(F, P) bool of the points that have a label."""
        if self.labels is None:
            raise ValueError("the points have no labels, expected some")
        return self.labels == label

    def frames(self, chosen: np.ndarray) -> "Seen":
        """Some frames of it."""
        labels = None if self.labels is None else self.labels[chosen]
        return Seen(self.points[chosen], self.poses[chosen], self.trans[chosen], self.body, labels)


class BodySequences:
    """Sequences of a garment type with the bodies, of both genders, that move in them."""

    def __init__(self, data: SequenceData, bodies: BodySet) -> None:
        self.data, self.bodies = data, bodies
        self._body = lru_cache(_KEPT_BODIES)(
            lambda sequence: bodies.of(str(data.gender[sequence]), data.shape[sequence])
        )

    def body(self, sequence: int) -> ShapedBody:
        """The body of a sequence."""
        return self._body(int(sequence))

    def arrays(self) -> dict[str, np.ndarray]:
        """Every array that a training depends on by name, for a digest of them."""
        bodies = {f"bodies/{key}": value for key, value in self.bodies.arrays().items()}
        return self.data.arrays() | bodies

    def batch(self, windows: np.ndarray, frames: int) -> dict[str, Any]:
        """Arrays of windows.

        Args:
            windows: (B, 2) as from `SequenceData.windows`.
            frames: T.

        Returns:
            `points` (B, T, P, 3), `labels` (B, T, P) int64, `canonical` (B, N, 3),
            `coefficients` (B, D), `rest_body` and `rest_normals` (B, M, 3), `names`, and the
            windows as `sequence` and `start` (B,).
        """
        data = self.data
        chosen = windows[:, 0]
        spans = self.spans(windows, frames)
        rest = [self.body(sequence).rest_surface for sequence in chosen]
        return {
            "points": np.stack([data.points[span] for span in spans]),
            "labels": np.stack([data.labels[span] for span in spans]).astype(np.int64),
            "canonical": data.canonical[chosen],
            "coefficients": data.coefficients[chosen].astype(np.float32),
            "rest_body": np.stack([vertices for vertices, _ in rest]).astype(np.float32),
            "rest_normals": np.stack([normals for _, normals in rest]).astype(np.float32),
            "sequence": chosen,
            "start": windows[:, 1],
            "names": [
                f"{data.name[sequence]}/{data.number[span.start]}"
                for sequence, span in zip(chosen, spans, strict=True)
            ],
        }

    def seen(self, sequence: int, labels: np.ndarray | None = None) -> Seen:
        """A whole sequence, with labels (F, P) if any."""
        data, rows = self.data, self.data.rows(sequence)
        body = self.body(sequence)
        return Seen(data.points[rows], data.poses[rows], data.trans[rows], body, labels)

    def spans(self, windows: np.ndarray, frames: int) -> list[slice]:
        """Rows of windows (B, 2) of T frames among the frames of all sequences."""
        starts = [int(self.data.start[sequence]) + int(start) for sequence, start in windows]
        return [slice(row, row + frames) for row in starts]


class Windows:
    """Windows of the training and validation splits as rows that networks are trained on.

    If the validation split holds no sequence of the wanted sources, its windows are those of any
    source: a network must be selected by something that it was not trained on.

    Args:
        sequences: where batches come from.
        frames: T.
        stride: from one training window to the next; validation windows do not overlap.
        sources: of the sequences.
        most_validated: validation windows of each sequence at most, evenly spread; None for all.
            Where all windows of a sequence have one true garment, long sequences would otherwise
            outvote the short ones.
    """

    def __init__(
        self,
        sequences: BodySequences,
        *,
        frames: int,
        stride: int,
        sources: Sequence[str] = KINDS,
        most_validated: int | None = None,
    ) -> None:
        self.sequences, self.frames = sequences, frames
        train = sequences.data.windows("train", frames, stride, sources)
        val = self._validation_windows(sources, most_validated)
        if not len(val):
            val = self._validation_windows(KINDS, most_validated)
            LOGGER.warning(
                "no %s %s in the validation split: the network is selected on %d windows of others",
                " or ".join(sources),
                sequences.data.garment_type,
                len(val),
            )
        self._windows = np.concatenate([train, val])
        self._rows = {
            "train": np.arange(len(train)),
            "val": np.arange(len(train), len(self._windows)),
        }

    def __len__(self) -> int:
        return len(self._windows)

    def _validation_windows(self, sources: Sequence[str], most: int | None) -> np.ndarray:
        val = self.sequences.data.windows("val", self.frames, self.frames, sources)
        if most is None or not len(val):
            return val
        return np.concatenate(
            [spread_rows(val[val[:, 0] == s], most) for s in np.unique(val[:, 0])]
        )

    def rows(self, split: str) -> np.ndarray:
        """Rows of "train" or "val"."""
        return self._rows[split]

    def batch(self, rows: np.ndarray) -> dict[str, Any]:
        """See `BodySequences.batch`."""
        return self.sequences.batch(self._windows[rows], self.frames)


def spread_rows(rows: np.ndarray, most: int) -> np.ndarray:
    """At most so many of the rows (R, ...), evenly spread."""
    return rows[np.linspace(0, len(rows) - 1, min(most, len(rows))).round().astype(int)]


class SequenceWindows:
    """Windows that cover a sequence, a few at a time."""

    def __init__(self, count: int, frames: int, stride: int | None = None) -> None:
        self.count, self.frames = count, frames
        starts = window_starts(count, frames, stride or frames, "to reconstruct")
        self.starts = np.array(starts)

    def batches(self) -> Iterator[np.ndarray]:
        """First frames of the windows, batch by batch."""
        for first in range(0, len(self.starts), _WINDOWS):
            yield self.starts[first : first + _WINDOWS]

    def of(self, starts: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Values (F, ...) of windows, (B, T, ...)."""
        rows = starts[:, None] + np.arange(self.frames)
        return np.ascontiguousarray(values[rows])

    def mean(self, shape: Sequence[int]) -> "FrameMean":
        """To fill with values of `shape` per frame."""
        return FrameMean(self, shape)


class FrameMean:
    """Mean over all windows that hold a frame."""

    def __init__(self, windows: SequenceWindows, shape: Sequence[int]) -> None:
        self._frames = windows.frames
        self._sum = np.zeros((windows.count, *shape), dtype=np.float32)
        self._held = np.zeros(windows.count, dtype=np.float32)

    def add(self, starts: np.ndarray, values: np.ndarray) -> None:
        """Values (B, T, ...) of windows."""
        for start, value in zip(starts, values, strict=True):
            self._sum[start : start + self._frames] += value
            self._held[start : start + self._frames] += 1

    def __call__(self) -> np.ndarray:
        """(F, ...)."""
        return self._sum / self._held.reshape(-1, *[1] * (self._sum.ndim - 1))


class DressedSequences(BodySequences):
    """Sequences with a canonical garment for each body, skinned to it in one way.

    Args:
        sequences: with their bodies.
        canonical: (S, N, 3) garments that are worn.
        skinning: how they follow the bodies.
    """

    def __init__(
        self, sequences: BodySequences, canonical: np.ndarray, skinning: SkinningSettings
    ) -> None:
        super().__init__(sequences.data, sequences.bodies)
        self.canonical, self.skinning = canonical, skinning
        self._weights: ByteCache[int, np.ndarray] = ByteCache(_KEPT_BYTES)
        self._motions: ByteCache[int, tuple[np.ndarray, ...]] = ByteCache(_KEPT_BYTES)

    def weights(self, sequence: int) -> np.ndarray:
        """(N, 24) float32 skinning weights of the garment that is worn in a sequence."""
        sequence = int(sequence)
        if sequence in self._weights:
            return self._weights[sequence]
        faces = self.data.space.faces
        weights = skinning_weights(
            self.body(sequence), self.canonical[sequence], faces, self.skinning
        )
        self._weights.add(sequence, weights)
        return weights

    def batch(self, windows: np.ndarray, frames: int) -> dict[str, Any]:
        """Arrays of windows; see `BodySequences.batch`.

        Returns:
            What is given there, and `target` (B, T, N, 3), `poses` (B, T, 72), `body` and
            `body_normals` (B, T, M, 3), `transforms` (B, T, 24, 4, 4), `worn` (B, N, 3),
            `weights` (B, N, 24) and `proposal` (B, T, N, 3).
        """
        batch = super().batch(windows, frames)
        chosen, spans = batch["sequence"], self.spans(windows, frames)
        motions = [self._motion(int(s), int(start), frames) for s, start in windows]
        batch |= {
            key: np.stack([motion[part] for motion in motions]).astype(np.float32)
            for part, key in enumerate(("body", "body_normals", "transforms"))
        }
        batch |= {
            "target": np.stack([self.data.garment[span] for span in spans]),
            "poses": np.stack([self.data.poses[span] for span in spans]),
            "worn": self.canonical[chosen].astype(np.float32),
            "weights": np.stack([self.weights(s) for s in chosen]),
        }
        batch["proposal"] = proposals(batch["worn"], batch["weights"], batch["transforms"])
        return batch

    def _motion(self, sequence: int, start: int, frames: int) -> tuple[np.ndarray, ...]:
        """Body vertices, their normals and joint transforms in some frames of a sequence.

        They are kept for the whole sequence while there is room, and otherwise computed for the
        frames asked for alone.
        """
        span, rows = slice(start, start + frames), self.data.rows(sequence)
        if sequence not in self._motions:
            part, count = self._move(sequence, self.data.poses[rows][span]), rows.stop - rows.start
            if not self._motions.has_room(count_bytes(part) // frames * count):
                return part
            whole = part if frames == count else self._move(sequence, self.data.poses[rows])
            self._motions.add(sequence, whole)
        return tuple(x[span] for x in self._motions[sequence])

    def _move(self, sequence: int, poses: np.ndarray) -> tuple[np.ndarray, ...]:
        body = self.body(sequence)
        return *body.pose_surface(poses), body.transforms(poses)


def skinning_weights(
    body: ShapedBody, canonical: np.ndarray, faces: np.ndarray, settings: SkinningSettings
) -> np.ndarray:
    """(N, 24) float32 weights of a canonical garment (N, 3), from a body's (equation 2)."""
    return interpolated_weights(
        canonical,
        faces,
        rest_body(body.model, body.shape),
        body.model.weights,
        settings.neighbours,
        settings.passes,
        power=settings.power,
        coincident=settings.coincident,
    )


def proposals(canonical: np.ndarray, weights: np.ndarray, transforms: np.ndarray) -> np.ndarray:
    """(B, T, N, 3) interpolated linear blend skinning of canonical garments (equation 1).

    Args:
        canonical: (B, N, 3).
        weights: (B, N, 24).
        transforms: (B, T, 24, 4, 4).
    """
    with torch.no_grad():
        tensors = map(torch.from_numpy, (canonical, weights, transforms))
        return linear_blend_skinning(*tensors).numpy()


def propose_garment(
    body: ShapedBody,
    poses: np.ndarray,
    canonical: np.ndarray,
    faces: np.ndarray,
    settings: SkinningSettings,
) -> np.ndarray:
    """(F, N, 3) proposals of a canonical garment on a body in poses (F, 72)."""
    weights = skinning_weights(body, canonical, faces, settings)
    return proposals(canonical[None], weights[None], body.transforms(poses)[None])[0]
