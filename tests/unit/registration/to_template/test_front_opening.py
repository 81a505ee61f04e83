"""Shirts that open in front are closed by a strip."""

import numpy as np
import pytest

from drapeline.geometry.mesh import boundary_loops, half_edges
from drapeline.registration.to_template.front_opening import front_strip
from toys.templates import round_skirt


def slit(vertices, triangles, chosen, gap=0.012):
    """Part the tube at angle -90 degrees where `chosen` says so of a column's heights."""
    angle = np.arctan2(vertices[:, 1], vertices[:, 0])
    column = np.flatnonzero((np.abs(angle + np.pi / 2) < 1e-6) & chosen(vertices[:, 2]))
    copies = len(vertices) + np.arange(len(column))
    swap = np.arange(len(vertices) + len(column))
    swap[column] = copies
    left = vertices[triangles].mean(axis=1)[:, 0] > 0
    cut = np.where(left[:, None], swap[triangles], triangles)
    points = np.concatenate([vertices, vertices[column]])
    points[column, 0] -= gap / 2
    points[copies, 0] += gap / 2
    return points, cut


@pytest.mark.parametrize("front", ["open", "polo"])
@pytest.mark.parametrize(("gap", "rows"), [(0.004, 25), (0.02, 25), (0.03, 25), (0.02, 12)])
def test_an_open_front_is_closed(front, gap, rows):
    vertices, triangles = round_skirt(around=40, rows=rows)
    top = 0.1 if front == "open" else -0.3
    points, cut = slit(vertices, triangles, lambda z: z > -9 if front == "open" else z > top, gap)
    assert len(boundary_loops(cut)) == (1 if front == "open" else 2)
    closed = np.concatenate([cut, front_strip(points, cut)])
    loops = boundary_loops(closed)
    assert len(loops) == 2
    for loop in loops:  # nothing of hem and neck is sewn up
        assert np.ptp(points[loop, 2]) < 0.025
        assert len(loop) >= 40
    _, uses = np.unique(half_edges(closed), axis=0, return_counts=True)
    assert uses.max() == 1


def test_a_closed_front_needs_no_strip():
    vertices, triangles = round_skirt(radius=0.1)
    assert len(front_strip(vertices, triangles)) == 0
