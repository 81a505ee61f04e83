import numpy as np

from drapeline.geometry.mesh import edges
from drapeline.registration.to_points import pairs_across, spring_lengths, springs

FACES = np.array([[0, 1, 2], [2, 1, 3], [2, 3, 4]])


def test_pairs_across_face_one_another():
    assert {tuple(sorted(pair)) for pair in pairs_across(FACES).tolist()} == {(0, 3), (1, 4)}


def test_springs_are_all_edges_and_then_the_pairs_across():
    pairs, across = springs(FACES)
    np.testing.assert_array_equal(pairs[~across], edges(FACES))
    np.testing.assert_array_equal(pairs[across], pairs_across(FACES))


def test_lengths_are_distances_in_every_frame():
    vertices = np.zeros((2, 5, 3))
    vertices[1, 3] = [3, 4, 0]
    lengths = spring_lengths(vertices, np.array([[0, 3], [0, 1]]))
    np.testing.assert_allclose(lengths, [[0, 0], [5, 0]])
