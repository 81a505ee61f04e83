"""Pictures of garments on their wearers: what they show, not that there are any."""

import numpy as np
import pytest
from PIL import Image

from drapeline.geometry.mesh import Mesh
from drapeline.report.models.views import (
    HEAT_SPAN_MM,
    View,
    plot_views,
    wearer_view,
)
from toys.views import TUBE, coloured, shown

BACKDROP = 255


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


def test_views_are_written_row_by_row(tmp_path):
    plot_views(tmp_path / "v.png", {"a": [View(TUBE, None)] * 2, "b": [View(TUBE, None)]})
    one, three = Image.open(tmp_path / "v.png").size, (2, 2)
    assert one[0] > three[0] * 240
    assert one[1] > three[1] * 250
