import subprocess
import sys

import numpy as np
import warp as wp

from drapeline.geometry.closest import closest_points
from drapeline.geometry.warp_mesh import move_mesh, start_warp, warp_mesh


@wp.kernel
def _find(mesh: wp.uint64, points: wp.array[wp.vec3], place: int, found: wp.array[int]):
    if wp.mesh_query_point_no_sign(mesh, points[0], 1.0).result:
        found[place] = 1


MESH = """
import os
import numpy as np
from drapeline.geometry.warp_mesh import start_warp, warp_mesh

mesh = warp_mesh(np.eye(3), np.array([[0, 1, 2]]))
assert mesh.points.numpy().tolist() == np.eye(3).tolist()
start_warp()
os.write(2, b"said afterwards")
"""


def test_warp_starts_without_a_word_and_gives_the_terminal_back():
    done = subprocess.run([sys.executable, "-c", MESH], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    assert (done.stdout, done.stderr) == ("", "said afterwards")


UNFINITE = """
import numpy as np
from drapeline.geometry.closest import closest_points

faces = np.array([[0, 1, 2], [0, 2, 3]])
place, face = closest_points(np.zeros((1, 3)), np.full((4, 3), np.nan), faces)
print(place.shape, face.shape)
"""


def test_a_mesh_of_nothing_but_nan_does_not_end_the_process():
    asked = [sys.executable, "-c", UNFINITE]
    done = subprocess.run(asked, capture_output=True, text=True, timeout=600)
    assert (done.returncode, done.stdout) == (0, "(1, 3) (1,)\n"), done.stderr


def test_a_warp_without_the_faster_index_has_the_other(monkeypatch):
    rng = np.random.default_rng(0)
    points, vertices = rng.normal(size=(50, 3)), rng.normal(size=(30, 3))
    faces = rng.permutation(30).reshape(-1, 3)
    fast, _ = closest_points(points, vertices, faces)
    monkeypatch.setattr(wp, "is_cubql_available", lambda: False)
    plain, _ = closest_points(points, vertices, faces)
    np.testing.assert_allclose(fast, plain, atol=1e-6)


def test_a_mesh_that_is_moved_is_found_where_it_is_now():
    start_warp()
    corners, faces = np.eye(3), np.array([[0, 1, 2]])
    mesh = warp_mesh(corners, faces)
    move_mesh(mesh, corners + 10)
    assert mesh.points.numpy().tolist() == (corners + 10).tolist()
    found = wp.zeros(2, dtype=int, device="cpu")
    for place, points in enumerate((corners, corners + 10)):
        points = wp.array(points.astype(np.float32), dtype=wp.vec3, device="cpu")
        wp.launch(_find, 1, inputs=[mesh.id, points, place], outputs=[found], device="cpu")
    assert found.numpy().tolist() == [0, 1]
