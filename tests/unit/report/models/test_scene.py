"""Views of a dressed body: what they hold, and where the camera stands."""

import numpy as np
import pytest

from drapeline.rendering.picture_grid import heat_parts
from drapeline.report.models.scene import Scene, fit_scene, share_scale
from toys.gcvae import tube, tube_faces

TUBE, FACES = 2 * tube() - [0, 0, 0.6], tube_faces(False)
SPAN_MM = 80.0


@pytest.mark.parametrize("turn_deg", [0, 70, 200])
@pytest.mark.parametrize("scale", [(1, 1, 1), (3, 0.5, 0.4), (0.2, 0.2, 2)])
def test_fitted_scene_holds_everything_and_is_not_wider_than_needed(turn_deg, scale):
    size = (120, 150)
    mesh = TUBE * scale + [5.0, -3.0, 0.0]
    floor = float(mesh[:, 2].min()) - 0.1
    scene = fit_scene(Scene(turn_deg=turn_deg, floor_z=floor), [mesh[:100], mesh[100:]], size)
    image, depth = scene.camera(size).project(mesh - [0, 0, floor])
    assert (depth > 3).all()
    assert ((image >= 0) & (image <= size)).all()
    share = np.ptp(image, axis=0) / size
    assert 0.65 < max(share) <= 1


def test_picture_shows_the_garment_on_the_floor_where_it_is():
    scene = fit_scene(Scene(floor_z=float(TUBE[:, 2].min())), [TUBE], (60, 64))
    error = np.where(TUBE[:, 2] > 0, SPAN_MM, 0.0)
    parts = heat_parts(TUBE, FACES, error[FACES].mean(axis=1), SPAN_MM)
    picture = scene.picture(parts, (60, 64), samples=6).astype(int)
    rows = np.flatnonzero((np.ptp(picture, axis=2) > 25).any(axis=1))
    assert rows[-1] > 0.88 * 64
    top, bottom = picture[rows[: len(rows) // 3]], picture[rows[-len(rows) // 3 :]]
    yellow = [((p[..., 0] - p[..., 2]) > 60).sum() for p in (top, bottom)]
    assert yellow[0] > 50 > 5 > yellow[1]


def test_scenes_that_share_a_scale_hold_the_largest_and_have_one_floor():
    size = (120, 150)
    small = fit_scene(Scene(floor_z=-1.0), [TUBE], size)
    large = fit_scene(Scene(front=(1.0, 0.0), floor_z=-3.0), [3 * TUBE], size)
    shared = share_scale([small, large])
    assert {scene.height_m for scene in shared} == {large.height_m}
    assert {scene.target[2] for scene in shared} == {large.target[2]}
    assert [scene.front for scene in shared] == [small.front, large.front]
    np.testing.assert_allclose(shared[0].target[:2], small.target[:2])
