"""Pictures of the garment VAE: what they show, not that there are any."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.predictions import GarmentCase
from drapeline.outfits.garment_types import GARMENTS
from drapeline.report.models.gcvae.figures import error_views, walk_view
from drapeline.report.models.scene import HEAT_SPAN_MM
from toys.views import TUBE, shown


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
