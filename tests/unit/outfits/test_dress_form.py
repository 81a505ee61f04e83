"""The dress form: larger than the body, smooth, symmetric."""

import numpy as np

from drapeline.bodies.rest_body import rest_body
from drapeline.geometry.signed_distance import SignedDistance
from drapeline.outfits.dress_form import CELL_M, Field


def test_the_form_is_symmetric(templates):
    for field in (templates.form.upper, templates.form.lower):
        np.testing.assert_array_equal(field.distance, field.distance[::-1])
        count = field.distance.shape[0]
        np.testing.assert_allclose(field.origin[0] + CELL_M * (count - 1) / 2, 0, atol=1e-9)


def test_landmarks_are_in_anatomical_order(templates):
    m = templates.form.landmarks
    order = ["ankle", "knee", "crotch", "hip", "waist", "armpit", "shoulder", "neck"]
    heights = [m[name] for name in order]
    assert heights == sorted(heights)
    assert m["shoulder_x"] < m["elbow_x"] < m["wrist_x"]


def test_the_form_covers_the_torso_and_fills_its_hollows(templates, toy_body):
    body = rest_body(toy_body, np.zeros(10))
    marks = templates.form.landmarks
    trunk = (body[:, 2] > marks["hip"]) & (body[:, 2] < marks["armpit"])
    trunk &= np.abs(body[:, 0]) < marks["shoulder_x"]
    assert templates.form.lower.value(body[trunk & (body[:, 2] < marks["waist"])]).max() < 0.012
    assert templates.form.upper.value(body[trunk & (body[:, 2] > marks["waist"])]).max() < 0.012


def test_the_form_s_distance_agrees_with_the_body_s(templates, toy_body):
    body = rest_body(toy_body, np.zeros(10))
    x = templates.form.landmarks["elbow_x"] - 0.08
    z = templates.form.landmarks["shoulder"] + np.linspace(0.06, 0.15, 8)
    points = np.column_stack([np.full(8, x), np.zeros(8), z])
    exact, _ = SignedDistance(body, toy_body.faces).query(points)
    np.testing.assert_allclose(templates.form.upper.value(points), exact, atol=0.015)


def test_points_are_lifted_and_landed_on_levels_of_a_ball():
    axis = CELL_M * np.arange(-30, 31)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1)
    ball = Field(np.full(3, axis[0]), (np.linalg.norm(grid, axis=-1) - 0.15).astype(np.float32))
    points = np.array([[0.1, 0.02, 0.0], [0.0, 0.2, 0.05], [0.05, 0.05, -0.13]])
    lifted = ball.lift(points, 0.02)
    assert ball.value(lifted).min() > 0.02 - 5e-4
    np.testing.assert_array_equal(lifted[1], points[1])
    radius = np.linalg.norm(ball.land(points, 0.01), axis=1)
    np.testing.assert_allclose(radius, 0.16, atol=1e-3)
