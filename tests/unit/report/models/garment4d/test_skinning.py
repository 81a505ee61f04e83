"""Figure 7 of Garment4D: the place where skinning tears a garment is found and ringed."""

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from drapeline.report.models.garment4d.skinning import SkinnedTwice, plot_neighbours, worst_place
from toys.gcvae import tube, tube_faces

TUBE, FACES = 2 * tube() - [0, 0, 0.6], tube_faces(False)


def test_the_worst_place_is_where_edges_changed_most():
    posed = Rotation.from_rotvec([0.3, 1, 2]).apply(TUBE) + 5
    posed[77] += 0.2
    assert worst_place(TUBE, posed, FACES) == 77


def test_neighbours_ring_the_worst_place_beside_its_close_up(made, tmp_path):
    nearest = TUBE.copy()
    vertex = int(np.argmax(TUBE[:, 0] - np.abs(TUBE[:, 2])))
    nearest[vertex] += [0.1, 0, 0]
    twice = SkinnedTwice("a", "Skirt", TUBE, FACES, nearest, TUBE, 0.9 * TUBE, FACES, 1.0)
    plot_neighbours(tmp_path / "f7.png", [twice], 256)
    np.testing.assert_allclose(made[0][1].vertices - made[2][1].vertices, nearest - TUBE)
    sheet = np.asarray(Image.open(tmp_path / "f7.png")).astype(int)
    left = sheet.shape[1] - 4 * 256
    for column in range(4):
        panel = sheet[:, left + 256 * column : left + 256 * (column + 1)]
        ring = np.argwhere((np.abs(panel - [213, 94, 0]) < 40).all(-1))
        assert (len(ring) > 40) == (column % 2 == 0)
        if column == 0:
            # The camera stands before the place, so that it is in the middle.
            assert abs(ring[:, 1].mean() - 125) < 25
