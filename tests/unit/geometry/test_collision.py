"""Cloth is pushed out of a ball, and rough cloth is smoothed before."""

import numpy as np
import pytest
import trimesh

from drapeline.geometry.collision import PenetrationResolver, resolve_penetration

GAP_M = 0.004
RADIUS_M = 0.1


def ball(radius_m):
    made = trimesh.creation.icosphere(subdivisions=4, radius=radius_m)
    return np.asarray(made.vertices), np.asarray(made.faces)


@pytest.mark.parametrize("depth_m", [0.001, 0.02, 0.05])
def test_a_shell_inside_a_ball_ends_up_around_it_by_the_gap(depth_m):
    body, body_faces = ball(RADIUS_M)
    cloth, faces = ball(RADIUS_M - depth_m)
    out = resolve_penetration(cloth[None], faces, body[None], body_faces)[0]
    height = np.linalg.norm(out, axis=1) - RADIUS_M
    np.testing.assert_allclose(height, GAP_M, atol=5e-4)


def test_smooth_cloth_outside_hardly_moves():
    body, body_faces = ball(RADIUS_M)
    cloth, faces = ball(RADIUS_M + 0.05)
    out = resolve_penetration(cloth[None], faces, body[None], body_faces)[0]
    np.testing.assert_allclose(out, cloth, atol=1.5e-3)


def test_rough_cloth_is_evened_out():
    body, body_faces = ball(RADIUS_M)
    cloth, faces = ball(RADIUS_M + 0.05)
    rough = cloth * (1 + 0.05 * np.random.default_rng(0).standard_normal((len(cloth), 1)))
    out = resolve_penetration(rough[None], faces, body[None], body_faces)[0]
    before, after = (np.linalg.norm(x, axis=1).std() for x in (rough, out))
    assert after < before / 2


def test_each_frame_leaves_its_own_body():
    body, body_faces = ball(RADIUS_M)
    cloth, faces = ball(RADIUS_M - 0.01)
    shift = np.array([0.3, 0.0, 0.0])
    bodies = np.stack([body, body + shift])
    both = resolve_penetration(np.stack([cloth, cloth + shift]), faces, bodies, body_faces)
    # Which of two faces at one distance is nearest is a matter of rounding.
    np.testing.assert_allclose(both[1], both[0] + shift, atol=2e-3)


def test_coarse_cloth_is_pushed_out_between_its_vertices():
    body, body_faces = ball(RADIUS_M)
    coarse = trimesh.creation.icosphere(subdivisions=1, radius=RADIUS_M + GAP_M)
    cloth, faces = np.asarray(coarse.vertices, np.float32), np.asarray(coarse.faces)
    assert np.linalg.norm(cloth[faces].mean(axis=1), axis=1).min() < RADIUS_M - 0.001
    out = PenetrationResolver(body, body_faces).push_faces_out(cloth, faces)
    assert np.linalg.norm(out[faces].mean(axis=1), axis=1).min() > RADIUS_M
    far = np.asarray(2 * cloth)
    np.testing.assert_array_equal(
        PenetrationResolver(body, body_faces).push_faces_out(far, faces), far
    )


def test_a_body_is_wanted_for_every_frame():
    body, body_faces = ball(RADIUS_M)
    with pytest.raises(ValueError, match="2 frames of cloth came with 1 bodies"):
        resolve_penetration(np.stack([body, body]), body_faces, body[None], body_faces)


def test_cloth_that_is_outside_stays():
    body, body_faces = ball(RADIUS_M)
    cloth, _ = ball(2 * RADIUS_M)
    resolver = PenetrationResolver(body, body_faces)
    np.testing.assert_array_equal(
        resolver.push_out(cloth.astype(np.float32), None), np.float32(cloth)
    )
