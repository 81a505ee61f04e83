from dataclasses import replace

import numpy as np

from drapeline.bodies.rest_body import rest_body
from drapeline.geometry.mesh import vertex_normals
from drapeline.learning_data.occlusion import (
    TexturePixels,
    covered_vertices,
    texture_pixels,
)
from toys.smplicit import tube


def test_skin_behind_cloth_is_covered_and_skin_below_a_hem_is_not():
    """The cloth is the nearest surface to both."""
    leg = tube(0.1, -1.0, 0.0, around=64, rings=51)
    skirt = tube(0.12, -0.5, -0.1)
    covered = covered_vertices(leg.vertices, leg.faces, skirt)
    height = leg.vertices[:, 2]
    behind = (height > -0.48) & (height < -0.12)
    assert covered[behind].all()
    assert not covered[(height < -0.52) | (height > -0.08)].any()


def test_cloth_that_cuts_into_the_skin_a_little_covers_it():
    leg = tube(0.1, -1.0, 0.0)
    within = tube(0.097, -1.0, 0.0, around=64)
    assert covered_vertices(leg.vertices, leg.faces, within)[32:-32].all()


def test_cloth_far_away_covers_nothing():
    leg = tube(0.1, -1.0, 0.0)
    assert not covered_vertices(leg.vertices, leg.faces, tube(0.6, -2.0, 1.0)).any()


def slow_pixels(uv, faces, resolution):
    """Every pixel's centre in every triangle."""
    found = {}
    for row in range(resolution):
        for column in range(resolution):
            place = [(column + 0.5) / resolution, 1 - (row + 0.5) / resolution]
            for triangle, corners in zip(uv, faces, strict=True):
                if np.abs(triangle.mean(axis=0) - place).max() > 0.2:
                    continue
                system = np.vstack([triangle.T, np.ones(3)])
                if abs(np.linalg.det(system)) < 1e-12:
                    continue
                weights = np.linalg.solve(system, [*place, 1])
                if (weights > 1e-6).all():
                    found[row * resolution + column] = dict(zip(corners, weights, strict=True))
    return found


def test_pixels_lie_where_a_slow_search_finds_them(toy_body):
    some = np.arange(0, len(toy_body.faces), 5)
    body = replace(toy_body, faces=toy_body.faces[some], ft=toy_body.ft[some])
    pixels = texture_pixels(body, 12)
    expected = slow_pixels(body.vt[body.ft].astype(float), body.faces, 12)
    assert len(expected) > 3
    for pixel, weights in expected.items():
        found = dict(zip(pixels.corners[pixel], pixels.weights[pixel], strict=True))
        value = np.random.default_rng(pixel).random(len(body.v_template))
        # Where triangles overlap, either may be shown.
        if set(found) == set(weights):
            a = sum(value[k] * w for k, w in weights.items())
            assert np.isclose(a, sum(value[k] * w for k, w in found.items()), atol=1e-4)
        assert pixels.weights[pixel].sum() > 0.999


def test_an_image_shows_what_most_of_a_face_has():
    corners, weights = np.array([[0, 1, 2]] * 4), np.tile([0.4, 0.35, 0.25], (4, 1))
    pixels = TexturePixels(corners, weights)
    assert pixels.resolution == 2
    assert pixels.image(np.array([True, True, False])).all()
    assert not pixels.image(np.array([True, False, False])).any()
    nowhere = TexturePixels(corners, 0 * weights)
    assert not nowhere.image(np.ones(3, bool)).any()


def test_a_body_without_texture_is_seen_from_both_sides(toy_body):
    plain = replace(toy_body, vt=None, ft=None)
    pixels = texture_pixels(plain, 48)
    shown = pixels.weights.sum(axis=1) > 0
    front = vertex_normals(toy_body.v_template, toy_body.faces)[:, 2] > 0.5
    image = pixels.image(front)
    left, right = image[:, :24], image[:, 24:]
    assert shown.mean() > 0.05
    assert left.sum() > 20
    assert not right.any()


def test_the_image_of_a_skirt_is_where_the_legs_are(toy_body):
    vertices = rest_body(toy_body, np.zeros(10))
    covered = covered_vertices(vertices, toy_body.faces, tube(0.4, -0.5, 0.0))
    pixels = texture_pixels(toy_body, 32)
    assert 0 < pixels.image(covered).mean() < 0.5
