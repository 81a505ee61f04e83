"""Pictures of the garment VAE: what they show, not that there are any."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.predictions import GarmentCase
from drapeline.outfits.garment_types import GARMENTS
from drapeline.report.models.gcvae.views import (
    HEAT_SPAN_MM,
    View,
    error_views,
    plot_views,
    view_picture,
    walk_view,
    wearer_view,
)
from gcvae_toys import tube, tube_faces

TUBE = Mesh((2 * tube() - [0, 0, 0.6]).astype(np.float32), tube_faces(False))
BACKDROP = 255


def shown(view, **settings):
    return view_picture(view, size=(60, 64), samples=6, **settings).astype(int)


def coloured(picture):
    return np.ptp(picture, axis=2) > 25


def test_error_is_drawn_where_it_is():
    error = np.where(TUBE.vertices[:, 2] > 0, HEAT_SPAN_MM, 0.0)
    picture = shown(View(TUBE, None, error_mm=error))
    rows = np.flatnonzero(coloured(picture).any(axis=1))
    top, bottom = picture[rows[: len(rows) // 3]], picture[rows[-len(rows) // 3 :]]
    yellow = lambda p: ((p[..., 0] - p[..., 2]) > 60).sum()  # noqa: E731
    blue = lambda p: ((p[..., 2] - p[..., 1]) > 15).sum()  # noqa: E731
    assert yellow(top) > 50 > 5 > yellow(bottom)
    assert blue(bottom) > 50 > 5 > blue(top)


def test_views_of_one_size_have_one_scale():
    tall = Mesh(TUBE.vertices * 1.5, TUBE.faces)
    heights = [
        np.count_nonzero(coloured(shown(View(mesh, None, (0.2, 0.4, 0.9)))).any(axis=1))
        for mesh in (TUBE, tall)
    ]
    assert heights[1] / heights[0] == pytest.approx(1.5, rel=0.1)


def test_nothing_to_draw_is_an_even_picture():
    nothing = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    assert (shown(View(nothing, None)) == BACKDROP).all()


def test_the_wearer_stands_on_the_floor():
    high = Mesh(TUBE.vertices + [0, 0, 5], TUBE.faces)
    np.testing.assert_allclose(shown(wearer_view(high)), shown(wearer_view(TUBE)), atol=2)


def test_types_have_colours_of_their_own():
    pictures = [shown(walk_view(TUBE, TUBE, garment)) for garment in GARMENTS]
    for i, one in enumerate(pictures):
        for other in pictures[:i]:
            assert np.abs(one - other).max() > 40


def test_error_row_shows_each_error_on_the_mesh_that_has_it():
    mask = TUBE.vertices[:, 2] > -0.3
    original = Mesh(TUBE.vertices + [0.01, 0, 0], TUBE.faces)
    predicted = TUBE.vertices + np.where(TUBE.vertices[:, 2:] > 0, 0.02, 0)
    case = GarmentCase(
        "tube", original, TUBE.vertices, mask, predicted, ~mask, TUBE.faces, TUBE, REST_POSE[:3]
    )
    views = error_views(case)
    assert len(views) == 5
    assert views[2].garment is original
    assert len(views[2].error_mm) == len(original.vertices)
    assert views[2].error_mm.max() > 9
    error = views[4].error_mm
    assert len(error) == len(views[4].garment.vertices) == mask.sum()
    high = views[4].garment.vertices[:, 2] > 0.03
    np.testing.assert_allclose(error[high], 20 * np.sqrt(3), rtol=1e-4)
    assert error[views[4].garment.vertices[:, 2] <= 0].max() < 1e-3
    # The reconstruction itself has the predicted mask.
    assert views[3].garment.vertices[:, 2].max() < views[1].garment.vertices[:, 2].min() + 0.1


@pytest.mark.parametrize("turn", [0.0, 1.0, np.pi])
def test_the_camera_stands_before_the_wearer(turn):
    """A body that turns about the vertical takes the camera along."""
    spin = Rotation.from_rotvec([0, 0, turn])
    marked = np.where(TUBE.vertices[:, 1] < -0.1, HEAT_SPAN_MM, 0.0)  # its front is towards -Y
    pictures = []
    for rotation in (Rotation.identity(), spin):
        mesh = Mesh(rotation.apply(TUBE.vertices).astype(np.float32), TUBE.faces)
        root = (rotation * Rotation.from_rotvec(np.array(REST_POSE[:3]))).as_rotvec()
        mask = np.ones(len(mesh.vertices), dtype=bool)
        case = GarmentCase(
            "", mesh, mesh.vertices, mask, mesh.vertices, mask, mesh.faces, mesh, root
        )
        view = error_views(case)[2]
        pictures.append(shown(replace(view, error_mm=marked)))
    assert np.abs(pictures[0] - pictures[1]).mean() < 3


def test_views_are_written_row_by_row(tmp_path):
    plot_views(tmp_path / "v.png", {"a": [View(TUBE, None)] * 2, "b": [View(TUBE, None)]})
    one, three = Image.open(tmp_path / "v.png").size, (2, 2)
    assert one[0] > three[0] * 240
    assert one[1] > three[1] * 250
