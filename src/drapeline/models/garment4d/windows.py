"""Windows of sequences, a few frames each, and batches of them for the canonical stage.

All coordinates are metres relative to the root joint, Z up. S sequences, P points of a cloud, N
vertices of the template, M body vertices that networks are given, T frames of a window, D
components of the garment space.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from drapeline.learning_data.sequences import KINDS, SequenceData
from drapeline.models.garment4d.body_input import BodySet, PosedBody
from drapeline.rule_log import LOGGER

_KEPT_BODIES = 512  # of some hundred kilobytes each


class BodySequences:
    """Sequences of a garment type with the bodies that move in them.

    Args:
        data: the sequences.
        bodies: of both genders.
    """

    def __init__(self, data: SequenceData, bodies: BodySet) -> None:
        self.data, self.bodies = data, bodies
        self._body = lru_cache(_KEPT_BODIES)(
            lambda sequence: bodies.of(int(data.gender[sequence]), data.shape[sequence])
        )

    def body(self, sequence: int) -> PosedBody:
        """The body of a sequence."""
        return self._body(int(sequence))

    def arrays(self) -> dict[str, np.ndarray]:
        """Every array that a training depends on by name, for a digest of them."""
        bodies = {f"bodies/{key}": value for key, value in self.bodies.arrays().items()}
        return self.data.arrays() | bodies

    def batch(
        self, windows: np.ndarray, frames: int, *, body_relative_points: bool = False
    ) -> dict[str, Any]:
        """Arrays of windows.

        Args:
            windows: (B, 2) as from `SequenceData.windows`.
            frames: T.
            body_relative_points: whether points also say where on the body they are.

        Returns:
            `points` (B, T, P, 3 or 7), `labels` (B, T, P) int64, `canonical` (B, N, 3),
            `coefficients` (B, D), `rest_body` and `rest_normals` (B, M, 3), `names`, and the
            windows as `sequence` and `start` (B,).
        """
        data = self.data
        parts = [(int(s), slice(int(start), int(start) + frames)) for s, start in windows]
        chosen = np.array([sequence for sequence, _ in parts])
        spans = self.spans(windows, frames)
        rest = [self.body(sequence).rest_surface for sequence in chosen]
        return {
            "points": np.stack(
                [
                    data.clouds(s, body_relative_points=body_relative_points, frames=part)
                    for s, part in parts
                ]
            ),
            "labels": np.stack([data.labels[span] for span in spans]).astype(np.int64),
            "canonical": data.canonical[chosen],
            "coefficients": data.coefficients[chosen].astype(np.float32),
            "rest_body": np.stack([vertices for vertices, _ in rest]).astype(np.float32),
            "rest_normals": np.stack([normals for _, normals in rest]).astype(np.float32),
            "sequence": chosen,
            "start": np.array([part.start for _, part in parts]),
            "names": [
                f"{data.name[sequence]}/{data.number[span.start]}"
                for sequence, span in zip(chosen, spans, strict=True)
            ],
        }

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
        body_relative_points: whether points also say where on the body they are.
    """

    def __init__(
        self,
        sequences: BodySequences,
        *,
        frames: int,
        stride: int,
        sources: Sequence[str] = KINDS,
        most_validated: int | None = None,
        body_relative_points: bool = False,
    ) -> None:
        self.sequences, self.frames = sequences, frames
        self.body_relative_points = body_relative_points
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
        return np.concatenate([_spread(val[val[:, 0] == s], most) for s in np.unique(val[:, 0])])

    def rows(self, split: str) -> np.ndarray:
        """Rows of "train" or "val"."""
        return self._rows[split]

    def batch(self, rows: np.ndarray) -> dict[str, Any]:
        """See `BodySequences.batch`."""
        return self.sequences.batch(
            self._windows[rows], self.frames, body_relative_points=self.body_relative_points
        )


def _spread(windows: np.ndarray, most: int) -> np.ndarray:
    """At most so many of the windows (W, 2) of a sequence, evenly spread."""
    count = min(most, len(windows))
    return windows[np.linspace(0, len(windows) - 1, count).round().astype(int)]
