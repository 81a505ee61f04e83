"""Labels of points without a network, which a segmentation has to beat.

F frames, P points, B vertices of the body, L labels.
"""

import numpy as np

from drapeline.bodies.model import posed_vertices
from drapeline.dataset.labels import LABELS
from drapeline.learning_data.body_relative_points import nearest_vertices
from drapeline.models.garment4d.windows import BodySequences

ONE, BY_VERTEX = "one_label", "label_by_vertex"
_COUNTED = slice(None, None, 10)  # neighbouring frames hardly differ


class GuessedLabels:
    """What training points say of the label of any point.

    The guess `ONE` is the label that most of them have. `BY_VERTEX` is the one that most of them
    have among those that are nearest to the same vertex of the body, which must be known.

    Args:
        sequences: whose training points count, in every tenth frame.
    """

    def __init__(self, sequences: BodySequences) -> None:
        self._sequences = sequences
        votes = sum(self._votes(sequence) for sequence in sequences.data.of_split("train"))
        self._one = int(votes.sum(axis=0).argmax())
        self._by_vertex = np.where(votes.any(axis=1), votes.argmax(axis=1), self._one)

    def of(self, sequence: int) -> dict[str, np.ndarray]:
        """Guess -> labels (F, P) of a sequence's points."""
        nearest = self._nearest(sequence, slice(None))
        return {ONE: np.full(nearest.shape, self._one), BY_VERTEX: self._by_vertex[nearest]}

    def _votes(self, sequence: int) -> np.ndarray:
        """(B, L) points of a sequence that are nearest to each vertex, by label."""
        data, body = self._sequences.data, self._sequences.body(sequence).model
        labels = data.labels[data.rows(sequence)][_COUNTED]
        nearest = self._nearest(sequence, _COUNTED)
        votes = np.zeros((len(body.v_template), len(LABELS)), dtype=np.int64)
        np.add.at(votes, (nearest.ravel(), labels.ravel()), 1)
        return votes

    def _nearest(self, sequence: int, frames: slice) -> np.ndarray:
        """(F, P) the body's vertices that are nearest to the points in some frames."""
        data, body = self._sequences.data, self._sequences.body(sequence)
        points, poses = (each[data.rows(sequence)][frames] for each in (data.points, data.poses))
        posed = posed_vertices(body.model, body.shape, poses)[0]
        return np.stack([nearest_vertices(*pair) for pair in zip(posed, points, strict=True)])
