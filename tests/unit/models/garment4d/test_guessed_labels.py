"""Labels that toy points would get without a network."""

import numpy as np
from scipy.spatial.distance import cdist

from drapeline.bodies.model import posed_vertices
from drapeline.models.garment4d.guessed_labels import BY_VERTEX, ONE, GuessedLabels


def nearest_vertices(sequences, sequence):
    """(F, P) by comparing every point with every vertex."""
    data, body = sequences.data, sequences.body(sequence)
    rows = data.rows(sequence)
    posed = posed_vertices(body.model, body.shape, data.poses[rows])[0]
    pairs = zip(data.points[rows], posed, strict=True)
    return np.stack([cdist(*pair).argmin(axis=1) for pair in pairs])


def test_labels_are_guessed_by_the_vertex_beneath_a_point(sequences):
    data = sequences.data
    train, test = (data.of_split(split) for split in ("train", "test"))
    data.labels = np.array(data.labels)
    nearest = {int(s): nearest_vertices(sequences, s) for s in (*train, *test)}
    for sequence, vertices in nearest.items():
        data.labels[data.rows(sequence)] = np.where(vertices % 4, 2, 5)
    seen = np.unique([nearest[int(s)][::10] for s in train])
    for sequence in test:
        guessed = GuessedLabels(sequences).of(sequence)
        assert (guessed[ONE] == 2).all()
        known = np.isin(vertices := nearest[int(sequence)], seen)
        assert known.any()
        true = data.labels[data.rows(sequence)]
        assert guessed[BY_VERTEX].shape == vertices.shape
        np.testing.assert_array_equal(guessed[BY_VERTEX], np.where(known, true, 2))


def test_the_label_of_most_points_at_a_vertex_counts(sequences):
    data = sequences.data
    data.labels = np.array(data.labels)
    votes = {}
    for number, sequence in enumerate(data.of_split("train")):
        labels = data.labels[data.rows(sequence)]
        labels[:] = (np.arange(labels.shape[1]) + number) % 3
        vertices = nearest_vertices(sequences, sequence)
        for vertex, label in zip(vertices[::10].ravel(), labels[::10].ravel(), strict=True):
            votes.setdefault(int(vertex), np.zeros(3, dtype=int))[label] += 1
    sequence = int(data.of_split("test")[0])
    one = int(sum(votes.values()).argmax())
    expected = [
        [votes[v].argmax() if v in votes else one for v in frame]
        for frame in nearest_vertices(sequences, sequence)
    ]
    found = GuessedLabels(sequences).of(sequence)
    np.testing.assert_array_equal(found[BY_VERTEX], expected)
    assert (found[ONE] == one).all()
