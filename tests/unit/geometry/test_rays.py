import numpy as np

from drapeline.geometry.rays import rays_hit
from toys.smplicit import tube

SHELL = tube(1.0, -1.0, 1.0)


def hits(start, direction, reach_m):
    rays = (np.array([start], float), np.array([direction], float))
    return bool(rays_hit(*rays, SHELL.vertices, SHELL.faces, reach_m=reach_m)[0])


def test_rays_meet_a_surface_from_either_side_within_their_reach():
    assert hits((0, 0, 0), (1, 0, 0), 1.1)
    assert hits((3, 0, 0), (-1, 0, 0), 2.1)
    assert not hits((0, 0, 0), (1, 0, 0), 0.9)


def test_rays_pass_through_openings_and_away():
    assert not hits((0, 0, 0), (0, 0, 1), 10)
    assert not hits((3, 0, 0), (1, 0, 0), 10)


def test_each_ray_has_its_own_answer():
    starts = np.array([[0, 0, 0], [0, 0, 5], [0.5, 0, 0]], float)
    ways = np.tile([[1.0, 0, 0]], (3, 1))
    found = rays_hit(starts, ways, SHELL.vertices, SHELL.faces, reach_m=2)
    assert found.tolist() == [True, False, True]
