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


def test_z_up_becomes_y_up_and_forward_becomes_z():
    np.testing.assert_array_equal(to_y_up(np.eye(3)), [[1, 0, 0], [0, 0, -1], [0, 1, 0]])
