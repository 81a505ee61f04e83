import numpy as np
from PIL import Image

from drapeline.geometry.mesh import Mesh
from drapeline.metrics.predictions import RebuiltGarment
from drapeline.report.models.smplicit.figures import REBUILT_COLUMNS, _rebuilt_views, plot_rebuilt
from toys.smplicit import tube

BODY = tube(0.15, -0.9, 0.6)
GARMENT = RebuiltGarment(
    "a skirt",
    "Skirt",
    tube(0.3, -0.5, 0.0),
    tube(0.32, -0.5, 0.0),
    tube(0.34, -0.5, 0.0),
    tube(0.36, -0.5, 0.0),
    BODY,
)


def test_a_row_shows_each_surface_and_the_error_of_the_layer():
    views = _rebuilt_views(GARMENT)
    assert len(views) == len(REBUILT_COLUMNS)
    radii = [np.linalg.norm(view.garment.vertices[:, :2], axis=1).max() for view in views]
    np.testing.assert_allclose(radii, [0.3, 0.32, 0.32, 0.34, 0.36], atol=1e-6)
    np.testing.assert_allclose(views[2].error_mm, 20, atol=2)
    assert views[2].body is None
    assert views[0].body is not None


def test_a_garment_of_which_nothing_is_left_is_drawn_without_it(tmp_path):
    none = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    plot_rebuilt(tmp_path / "a.png", [GARMENT._replace(sheet=none)])
    assert Image.open(tmp_path / "a.png").size[0] > 5 * 200
