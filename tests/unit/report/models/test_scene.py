"""Views of a dressed body: what they hold, and where the camera stands."""

import numpy as np
import pytest
from PIL import Image

from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.outfits.garment_types import LABELS
from drapeline.rendering.pictures import heat_parts
from drapeline.report.models.scene import (
    HEAT_SPAN_MM,
    GarmentPicture,
    Scene,
    cloud_parts,
    draw,
    fit_scene,
    plot_views,
    share_scale,
    wearer_view,
)
from toys.gcvae import tube, tube_faces
from toys.views import TUBE, coloured, shown

POINTS, FACES = 2 * tube() - [0, 0, 0.6], tube_faces(False)
SPAN_MM = 80.0


@pytest.mark.parametrize("turn_deg", [0, 70, 200])
@pytest.mark.parametrize("scale", [(1, 1, 1), (3, 0.5, 0.4), (0.2, 0.2, 2)])
def test_fitted_scene_holds_everything_and_is_not_wider_than_needed(turn_deg, scale):
    size = (120, 150)
    mesh = POINTS * scale + [5.0, -3.0, 0.0]
    floor = float(mesh[:, 2].min()) - 0.1
    scene = fit_scene(Scene(turn_deg=turn_deg, floor_z=floor), [mesh[:100], mesh[100:]], size)
    image, depth = scene.camera(size).project(mesh - [0, 0, floor])
    assert (depth > 3).all()
    assert ((image >= 0) & (image <= size)).all()
    share = np.ptp(image, axis=0) / size
    assert 0.65 < max(share) <= 1


def test_picture_shows_the_garment_on_the_floor_where_it_is():
    scene = fit_scene(Scene(floor_z=float(POINTS[:, 2].min())), [POINTS], (60, 64))
    error = np.where(POINTS[:, 2] > 0, SPAN_MM, 0.0)
    parts = heat_parts(POINTS, FACES, error[FACES].mean(axis=1), SPAN_MM)
    picture = scene.picture(parts, (60, 64), samples=6).astype(int)
    rows = np.flatnonzero((np.ptp(picture, axis=2) > 25).any(axis=1))
    assert rows[-1] > 0.88 * 64
    top, bottom = picture[rows[: len(rows) // 3]], picture[rows[-len(rows) // 3 :]]
    yellow = [((p[..., 0] - p[..., 2]) > 60).sum() for p in (top, bottom)]
    assert yellow[0] > 50 > 5 > yellow[1]


def test_scenes_that_share_a_scale_hold_the_largest_and_have_one_floor():
    size = (120, 150)
    small = fit_scene(Scene(floor_z=-1.0), [POINTS], size)
    large = fit_scene(Scene(front=(1.0, 0.0), floor_z=-3.0), [3 * POINTS], size)
    shared = share_scale([small, large])
    assert {scene.height_m for scene in shared} == {large.height_m}
    assert {scene.target[2] for scene in shared} == {large.target[2]}
    assert [scene.front for scene in shared] == [small.front, large.front]
    np.testing.assert_allclose(shared[0].target[:2], small.target[:2])


def test_points_become_balls_in_the_colours_of_their_labels():
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (60, 3))
    labels = np.repeat([0, LABELS.index("Skirt")], 30)
    parts = cloud_parts(points, labels, Scene())
    balls = np.concatenate([part.vertices.reshape(-1, 12, 3).mean(axis=1) for part in parts])
    assert len(balls) == 60
    np.testing.assert_allclose(np.sort(balls[:, 0]), np.sort(points[:, 0]), atol=1e-6)
    assert len({tuple(np.round(part.colour, 3)) for part in parts}) > 2


def test_what_is_far_is_paler():
    points = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    near, far = cloud_parts(points, np.full(2, LABELS.index("Skirt")), Scene(turn_deg=0.0))
    if near.vertices[:, 1].mean() > far.vertices[:, 1].mean():
        near, far = far, near
    assert np.sum(far.colour) > np.sum(near.colour)


BACKDROP = 255


def test_error_is_drawn_where_it_is():
    error = np.where(TUBE.vertices[:, 2] > 0, HEAT_SPAN_MM, 0.0)
    picture = shown(GarmentPicture(TUBE, None, error_mm=error))
    rows = np.flatnonzero(coloured(picture).any(axis=1))
    top, bottom = picture[rows[: len(rows) // 3]], picture[rows[-len(rows) // 3 :]]
    yellow = lambda p: ((p[..., 0] - p[..., 2]) > 60).sum()  # noqa: E731
    blue = lambda p: ((p[..., 2] - p[..., 1]) > 15).sum()  # noqa: E731
    assert yellow(top) > 50 > 5 > yellow(bottom)
    assert blue(bottom) > 50 > 5 > blue(top)


def test_views_of_one_size_have_one_scale():
    tall = Mesh(TUBE.vertices * 1.5, TUBE.faces)
    heights = [
        np.count_nonzero(coloured(shown(GarmentPicture(mesh, None, (0.2, 0.4, 0.9)))).any(axis=1))
        for mesh in (TUBE, tall)
    ]
    assert heights[1] / heights[0] == pytest.approx(1.5, rel=0.1)


def test_nothing_to_draw_is_an_even_picture():
    nothing = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    assert (shown(GarmentPicture(nothing, None)) == BACKDROP).all()


def test_the_wearer_stands_on_the_floor():
    high = Mesh(TUBE.vertices + [0, 0, 5], TUBE.faces)
    np.testing.assert_allclose(shown(wearer_view(high)), shown(wearer_view(TUBE)), atol=2)


def test_views_are_written_row_by_row(tmp_path):
    plot_views(
        tmp_path / "v.png",
        {"a": [GarmentPicture(TUBE, None)] * 2, "b": [GarmentPicture(TUBE, None)]},
    )
    one, three = Image.open(tmp_path / "v.png").size, (2, 2)
    assert one[0] > three[0] * 240
    assert one[1] > three[1] * 250


def test_a_drawn_garment_has_its_own_colour():
    mesh = Mesh(POINTS.astype(np.float32), FACES)
    skirt, dress = (draw({name: mesh}, (60, 80)) for name in ("Skirt", "Dress"))
    assert skirt.shape == (80, 60, 3)
    assert skirt.dtype == np.uint8
    differs = (skirt != dress).any(axis=2)
    assert 0.05 < differs.mean() < 0.9  # the cloth, and not what is behind it
    assert (draw({"Body": mesh}, (60, 80)) != skirt).any()


def test_what_cannot_be_drawn_is_refused():
    empty = Mesh(np.zeros((0, 3)), np.zeros((0, 3), int))
    for meshes, sentence in (
        ({"Cape": empty}, "'Cape', expected one of Body, Tshirt"),
        ({"Skirt": empty}, "no mesh has a face"),
        ({}, "no mesh has a face"),
    ):
        with pytest.raises(InputError, match=sentence):
            draw(meshes)
