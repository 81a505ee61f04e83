import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.geometry.mesh import triangulate
from drapeline.xpbd.threads import warp_directions, weft_directions
from toys.sheets import sheet

EDGE_M = 0.02


def tube(radius=0.1, rows=21):
    """A tube along the X axis: vertices and quads."""
    around = round(2 * np.pi * radius / EDGE_M)
    angle = 2 * np.pi * np.arange(around) / around
    x, angle = np.meshgrid(EDGE_M * np.arange(rows), angle, indexing="ij")
    points = np.stack([x, radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    number = np.arange(rows * around).reshape(rows, around)
    one, two = number[:-1], number[1:]
    quads = np.stack([one, two, np.roll(two, -1, 1), np.roll(one, -1, 1)], axis=-1)
    return points.reshape(-1, 3), quads.reshape(-1, 4)


@pytest.mark.parametrize("faces_of", [lambda faces: faces, triangulate])
@pytest.mark.parametrize("turn", [(0, 0, 0), (0, -90, 0), (35, 20, -50)])
def test_the_warp_runs_along_a_tube_however_it_lies(faces_of, turn):
    points, quads = tube()
    turned = Rotation.from_euler("xyz", turn, degrees=True)
    points, faces = turned.apply(points), faces_of(quads)
    warp = warp_directions(points, faces)
    along = abs(warp @ turned.apply([1, 0, 0]))
    assert along == pytest.approx(np.ones(len(faces)), abs=0.01)
    weft = weft_directions(points, faces, warp)
    assert (weft * warp).sum(axis=1) == pytest.approx(np.zeros(len(faces)), abs=1e-9)
    assert np.linalg.norm(weft, axis=1) == pytest.approx(np.ones(len(faces)))


def test_the_warp_of_a_hanging_sheet_hangs_down():
    piece = sheet(0.0, rows=9, columns=5, edge_m=EDGE_M)
    upright = Rotation.from_euler("zx", [40, 90], degrees=True).apply(piece.vertices)
    warp = warp_directions(upright, piece.faces)
    assert abs(warp[:, 2]) == pytest.approx(np.ones(len(piece.faces)), abs=0.01)


def test_faces_without_area_have_finite_directions():
    piece = sheet(0.0, rows=5, edge_m=EDGE_M)
    points = piece.vertices.astype(float)
    points[5:10] = points[:5]
    warp = warp_directions(points, piece.faces)
    assert np.isfinite(warp).all()
    assert np.isfinite(weft_directions(points, piece.faces, warp)).all()
