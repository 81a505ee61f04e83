import numpy as np

from drapeline.dataset.labels import LABELS
from drapeline.report.models.clouds import cloud_parts
from drapeline.report.models.scene import Scene


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
