"""Measures of garments by one function: distances that are known."""

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.metrics.measure import measure


def sheet(height=0.0, *, quads=True, side=12):
    """A level square metre at a height."""
    x, y = np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 1, side))
    vertices = np.stack([x.ravel(), y.ravel(), np.full(x.size, height)], 1).astype(np.float32)
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    faces = np.stack([corner, corner + 1, corner + side + 1, corner + side], 1).astype(np.int32)
    return Mesh(vertices, faces if quads else triangulate(faces))


def box(low, high):
    """A closed box between two corners."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    vertices = np.asarray(low) + corners * (np.asarray(high) - low)
    return Mesh(vertices.astype(np.float32), np.array(faces, dtype=np.int32))


def test_a_sheet_above_another_is_as_far_away_as_it_is():
    found = measure(sheet(0.01), sheet())
    assert found.keys() == {
        *("surface_error_mm", "normal_error_deg", "predicted_to_true_mm", "true_to_predicted_mm")
    }
    assert found["surface_error_mm"] == pytest.approx(10)
    assert found["normal_error_deg"] == pytest.approx(0, abs=0.1)
    assert found["predicted_to_true_mm"] == pytest.approx(10)


@pytest.mark.parametrize("other", [sheet(quads=False), sheet(side=7)])
def test_other_faces_leave_distances_between_surfaces_alone(other):
    for one in (sheet(0.02), [sheet(0.02)] * 6):
        found = measure(one, other if isinstance(one, Mesh) else [other] * 6)
        assert found.keys() == {"predicted_to_true_mm", "true_to_predicted_mm"}
        assert found["predicted_to_true_mm"] == pytest.approx(20)


def test_motion_has_errors_of_vertices_and_of_accelerations():
    true = [sheet() for _ in range(7)]
    raised = measure([sheet(0.01)] * 7, true)
    assert raised["vertex_error_mm"] == pytest.approx(10)
    assert raised["acceleration_error_m_s2"] == pytest.approx(0, abs=1e-4)
    falling = measure([sheet(-0.5 * 9.81 * (frame / 30) ** 2) for frame in range(7)], true)
    assert falling["acceleration_error_m_s2"] == pytest.approx(9.81, rel=1e-3)


def test_what_is_inside_the_body_is_counted():
    body = box([-0.1, -0.1, -0.5], [0.5, 1.1, 0.02])  # of twelve columns, six are within
    alone = measure(sheet(), body=body)
    assert alone["inside_share"] == pytest.approx(0.5)
    assert alone["inside_depth_mm"] == pytest.approx(20, rel=1e-3)
    assert alone["pieces"] == 1
    moving = measure([sheet()] * 6, body=[body] * 6)
    assert moving["inside_share"] == pytest.approx(0.5)
    assert measure(sheet(), body=box([2, 2, 2], [3, 3, 3]))["inside_share"] == 0


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (([sheet()], sheet()), "a single mesh beside a garment in motion, expected its frames"),
        ((sheet(), [sheet()]), "frames beside a single garment, expected a single mesh"),
        (([sheet()] * 3, [sheet()] * 2), "true has 2 frames, expected 3"),
        (([], []), "predicted has 0 frames, expected some"),
        (([sheet(), sheet(side=7)],), "predicted has other faces in frame 1, expected the same"),
    ],
)
def test_what_does_not_fit_together_is_refused(arguments, sentence):
    with pytest.raises(InputError, match=sentence):
        measure(*arguments)
