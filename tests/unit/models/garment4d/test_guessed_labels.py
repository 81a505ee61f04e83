"""Labels that toy points would get without a network."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from drapeline.bodies.model import posed_vertices
from drapeline.models.garment4d.evaluate import BY_VERTEX, ONE, GuessedLabels
from drapeline.seeding import rng_for

COUNTED = 10  # every so many frames of the training sequences


@pytest.fixture
def beneath(sequences):
    """Lays all points .1 mm above vertices of the body that have none within 2 mm.

    Sequence -> (F, P) these vertices.
    """
    data = sequences.data
    data.points, data.labels = np.array(data.points), np.array(data.labels)
    posed = {}
    for sequence in range(len(data)):
        body, poses = sequences.body(sequence), data.poses[data.rows(sequence)]
        posed[sequence] = posed_vertices(body.model, body.shape, poses)[0]
    gaps = [
        cKDTree(frame).query(frame, 2)[0][:, 1] for frames in posed.values() for frame in frames
    ]
    apart = np.flatnonzero(np.min(gaps, axis=0) > 0.002)
    vertices = {}
    for sequence, frames in posed.items():
        rng = rng_for(sequence, "points above vertices")
        size = len(frames), data.points.shape[1]
        vertices[sequence] = rng.choice(apart, size)
        at = np.take_along_axis(frames, vertices[sequence][..., None], axis=1)
        data.points[data.rows(sequence)] = at + [0, 0, 1e-4]
    return vertices


def test_labels_are_guessed_by_the_vertex_beneath_a_point(sequences, beneath):
    data = sequences.data
    train, test = (data.of_split(split).tolist() for split in ("train", "test"))
    for sequence, vertices in beneath.items():
        data.labels[data.rows(sequence)] = np.where(vertices % 4, 2, 5)
    seen = np.unique(np.concatenate([beneath[s][::COUNTED].ravel() for s in train]))
    for sequence in test:
        guessed = GuessedLabels(sequences).of(sequence)
        assert (guessed[ONE] == 2).all()
        known = np.isin(beneath[sequence], seen)
        assert known.any()
        assert not known.all()
        true = data.labels[data.rows(sequence)]
        np.testing.assert_array_equal(guessed[BY_VERTEX], np.where(known, true, 2))


def test_the_label_of_most_points_at_a_vertex_counts(sequences, beneath):
    data, votes = sequences.data, {}
    for sequence in data.of_split("train").tolist():
        labels = data.labels[data.rows(sequence)]
        labels[:] = rng_for(sequence, "labels").integers(3, size=labels.shape)
        pairs = zip(beneath[sequence][::COUNTED].ravel(), labels[::COUNTED].ravel(), strict=True)
        for vertex, label in pairs:
            votes.setdefault(vertex, np.zeros(3, dtype=int))[label] += 1
    assert any((count > 0).sum() > 1 for count in votes.values())
    one = sum(votes.values()).argmax()
    (sequence,) = data.of_split("test").tolist()[:1]
    expected = [
        [votes[v].argmax() if v in votes else one for v in frame] for frame in beneath[sequence]
    ]
    found = GuessedLabels(sequences).of(sequence)
    np.testing.assert_array_equal(found[BY_VERTEX], expected)
    assert (found[ONE] == one).all()
