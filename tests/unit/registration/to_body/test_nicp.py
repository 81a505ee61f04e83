"""Non-rigid ICP on shapes whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest

from drapeline.geometry.mesh import triangulate, vertex_normals
from drapeline.registration.to_body.nicp import NicpSettings, TargetSurface, fit_to_surface
from toys.tiny_sample import tube

SETTINGS = NicpSettings(nodes=60, samples=400)


def cylinder(radius, low=-0.5, high=0.5, around=48, rows=41):
    """A round tube about Z: vertices and triangles that face outwards."""
    mesh = tube(radius, low, high, around=around, rows=rows)
    vertices = mesh.vertices.astype(float)
    vertices[:, 1] /= 0.6
    triangles = triangulate(mesh.faces)
    if (vertex_normals(vertices, triangles)[:, :2] * vertices[:, :2]).sum() < 0:
        triangles = triangles[:, ::-1]
    return vertices, triangles


@pytest.fixture(scope="module")
def body():
    return cylinder(0.15)


@pytest.mark.parametrize("scale", [1.1, 1.5, 2.0])
def test_a_wide_tube_comes_to_lie_on_a_narrow_one(body, scale):
    garment, triangles = cylinder(0.15 * scale, -0.3, 0.3, around=40, rows=25)
    laid = fit_to_surface(garment, triangles, TargetSurface(*body, SETTINGS.turn_m), SETTINGS)
    radius = np.hypot(laid[:, 0], laid[:, 1])
    np.testing.assert_allclose(radius, 0.15, atol=0.004)
    # Every vertex keeps its side and its height.
    turn = np.angle((laid[:, 0] + 1j * laid[:, 1]) * (garment[:, 0] - 1j * garment[:, 1]))
    assert np.abs(turn).max() < 0.05
    np.testing.assert_allclose(laid[:, 2], garment[:, 2], atol=0.01)


def test_folds_come_out_flat_and_do_not_turn_over(body):
    garment, triangles = cylinder(0.22, -0.3, 0.3, around=120, rows=31)
    angle = np.arctan2(garment[:, 1], garment[:, 0])
    garment[:, :2] *= (1 + 0.08 * np.sin(12 * angle))[:, None]
    laid = fit_to_surface(garment, triangles, TargetSurface(*body, SETTINGS.turn_m), SETTINGS)
    a, b, c = (laid[triangles[:, i]] for i in range(3))
    outward = (np.cross(b - a, c - a)[:, :2] * (a + b + c)[:, :2]).sum(1)
    assert (outward > 0).mean() > 0.99
    assert np.abs(np.hypot(laid[:, 0], laid[:, 1]) - 0.15).mean() < 0.004


def test_a_sleeve_between_two_limbs_goes_to_the_one_it_faces():
    first, faces = cylinder(0.05)
    second = first + [0.14, 0, 0]
    both = np.concatenate([first, second]), np.concatenate([faces, faces + len(first)])
    garment, triangles = cylinder(0.085, -0.3, 0.3, around=40, rows=25)
    laid = fit_to_surface(garment, triangles, TargetSurface(*both, SETTINGS.turn_m), SETTINGS)
    assert np.hypot(laid[:, 0], laid[:, 1]).max() < 0.06


def test_closest_points_are_those_that_face_the_same_way():
    """Limbs a centimetre apart; each point is nearer to the one that faces it."""
    first, faces = cylinder(0.05)
    limbs = np.concatenate([first, first + [0.11, 0, 0]])
    surface = TargetSurface(limbs, np.concatenate([faces, faces + len(first)]), SETTINGS.turn_m)
    points = np.array([[0.058, 0, 0], [0.052, 0, 0]])
    goal, inside = surface.closest(points, np.array([[1.0, 0, 0], [-1, 0, 0]]))
    np.testing.assert_allclose(goal, [[0.05, 0, 0], [0.06, 0, 0]], atol=0.001)
    assert inside.all()


def test_what_lies_on_the_body_already_stays(body):
    garment, triangles = cylinder(0.15, -0.3, 0.3, rows=25)
    laid = fit_to_surface(garment, triangles, TargetSurface(*body, SETTINGS.turn_m), SETTINGS)
    assert np.abs(laid - garment).max() < 0.002


def test_a_scrap_beyond_the_body_s_open_end_stays_beside_the_garment(body):
    garment, triangles = cylinder(0.15, -0.3, 0.48, rows=25)
    scrap = np.array([[0.15, 0, 0.52], [0.15, 0.01, 0.52], [0.15, 0, 0.53]])
    both = np.concatenate([garment, scrap])
    corners = np.concatenate([triangles, [np.arange(len(garment), len(both))]])
    settings = replace(SETTINGS, nodes=8)  # none of them on the scrap
    laid = fit_to_surface(both, corners, TargetSurface(*body, SETTINGS.turn_m), settings)
    assert np.abs(laid - both).max() < 0.02


def test_it_is_deterministic_and_moves_with_the_garment(body):
    garment, triangles = cylinder(0.2, -0.3, 0.3, rows=25)
    first = fit_to_surface(garment, triangles, TargetSurface(*body, SETTINGS.turn_m), SETTINGS)
    again = fit_to_surface(garment, triangles, TargetSurface(*body, SETTINGS.turn_m), SETTINGS)
    np.testing.assert_array_equal(first, again)
    shift = np.array([1.0, -2.0, 0.5])
    moved = TargetSurface(body[0] + shift, body[1], SETTINGS.turn_m)
    np.testing.assert_allclose(
        fit_to_surface(garment + shift, triangles, moved, SETTINGS) - shift, first, atol=1e-5
    )


def test_more_rounds_at_low_stiffness_come_closer(body):
    garment, triangles = cylinder(0.2, -0.3, 0.3, rows=25)
    garment[:, 0] *= 1.4
    surface = TargetSurface(*body, SETTINGS.turn_m)
    stiff = replace(SETTINGS, stiffness=(10.0,), fine_rounds=0)
    soft = replace(SETTINGS, fine_rounds=0)
    errors = [
        np.abs(np.hypot(*fit_to_surface(garment, triangles, surface, s)[:, :2].T) - 0.15).mean()
        for s in (stiff, soft)
    ]
    assert errors[1] < errors[0]
