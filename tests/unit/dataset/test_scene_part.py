import numpy as np
import pytest

from drapeline.dataset import scene_part
from drapeline.dataset.scene_part import PLAIN_COLOUR, ScenePart, to_y_up
from drapeline.geometry.mesh import Mesh

FRAMES = np.arange(6 * 4 * 3, dtype=float).reshape(6, 4, 3)


@pytest.mark.parametrize("chunk", [1, 4, 6, 32])
def test_frames_are_read_a_few_at_a_time_and_each_once(chunk, monkeypatch):
    monkeypatch.setattr(scene_part, "_CHUNK", chunk)
    reads = []

    def read(start, stop):
        reads.append((start, stop))
        return FRAMES[start:stop]

    mesh = Mesh(FRAMES[0], np.array([[0, 1, 2, 3]]))
    part = ScenePart("Skirt", mesh, PLAIN_COLOUR, read, len(FRAMES))
    np.testing.assert_array_equal(list(part.frames()), FRAMES)
    assert all(stop - start <= chunk for start, stop in reads)
    assert len(reads) == -(-len(FRAMES) // chunk)


def test_colours_of_screens_become_linear():
    """Against values of the sRGB curve (IEC 61966-2-1)."""
    mesh = Mesh(FRAMES[0], np.array([[0, 1, 2, 3]]))
    part = ScenePart("Skirt", mesh, (0.0, 0.5, 1.0), lambda *_: FRAMES, len(FRAMES))
    np.testing.assert_allclose(part.linear_colour, [0.0, 0.214041, 1.0], atol=1e-6)
    dark = ScenePart("Skirt", mesh, (0.02, 0.04045, 0.05), lambda *_: FRAMES, len(FRAMES))
    np.testing.assert_allclose(dark.linear_colour, [0.001548, 0.003131, 0.003936], atol=1e-6)


def test_velocities_are_central_differences_and_one_sided_at_the_ends():
    points = np.array([0.0, 1.0, 4.0, 9.0, 16.0])[:, None, None] * np.ones((5, 4, 3))
    mesh = Mesh(points[0], np.array([[0, 1, 2, 3]]))
    part = ScenePart("Skirt", mesh, PLAIN_COLOUR, lambda start, stop: points[start:stop], 5)
    speeds = np.array([1.0, 2.0, 4.0, 6.0, 7.0]) * 30
    for start, stop in ((0, 5), (0, 1), (1, 3), (4, 5)):
        found = part.velocities(start, stop)
        assert found.shape == (stop - start, 4, 3)
        np.testing.assert_allclose(found[:, 0, 0], speeds[start:stop])
    still = ScenePart("Skirt", mesh, PLAIN_COLOUR, lambda start, stop: points[start:stop], 1)
    np.testing.assert_array_equal(still.velocities(0, 1), np.zeros((1, 4, 3)))


def test_z_up_becomes_y_up_and_forward_becomes_z():
    np.testing.assert_array_equal(to_y_up(np.eye(3)), [[1, 0, 0], [0, 0, -1], [0, 1, 0]])
