from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
import warp as wp

from drapeline.frames import JOINT_NAMES
from drapeline.geometry.mesh import triangulate
from drapeline.geometry.rays import rays_hit
from drapeline.geometry.warp_mesh import start_warp
from drapeline.xpbd.body_vertices import CoveredVertices, push_off_body_vertices
from drapeline.xpbd.cloth_contact import NearTriangles
from drapeline.xpbd.contact import make_all_moves, make_moves
from drapeline.xpbd.solver import XpbdCloth
from drapeline.xpbd.stepping import BusyLaunch, XpbdSettings
from toys.sheets import drop, sheet

GAP_M, MARGIN_M = 0.003, 0.012
RELEASE_M, STICK_M = 3e-4, 2e-5  # in a step
TRIANGLE = np.float32([[0.01, 0, 0], [-0.005, 0.009, 0], [-0.005, -0.009, 0]])


def vectors(rows):
    return wp.array(np.float32(rows).reshape(-1, 3), dtype=wp.vec3)


@pytest.fixture
def lift(parallel):
    """lift(height, ...) -> heights of a triangle's corners, in the end and when the step began."""
    start_warp()

    def run(height, then=None, faces=(0, 1, 2), joint="spine2", steps=1):
        corners = TRIANGLE + np.float32([0, 0, height])
        place = vectors(corners)
        before = vectors(corners if then is None else TRIANGLE + np.float32([0, 0, then]))
        triangles = wp.array([faces], dtype=wp.vec3i)
        layers = wp.zeros(3, dtype=int)
        cloth = NearTriangles(vectors(corners), triangles, layers, halves=1, parallel=parallel)
        # One vertex of the body at the origin, which faces up.
        segments = np.array([JOINT_NAMES.index(joint)])
        still = SimpleNamespace(
            frame=lambda _: np.zeros((1, 3)), segments=segments, faces=[[0] * 3]
        )
        skin = CoveredVertices(still, cloth, parallel=parallel)
        body = vectors([0, 0, 0]), vectors([0, 0, 0]), vectors([0, 0, 1])
        skin.find(place, body, margin_m=MARGIN_M)
        mass = wp.array(np.float32([1, 2, 3]), dtype=float)
        clock, friction = (wp.zeros(size, dtype=float) for size in (2, 3))
        launch = BusyLaunch(
            push_off_body_vertices,
            skin.count,
            [
                *(skin.count, skin.covers, skin.from_place, skin.to_place, skin.up),
                *(triangles, mass, clock, vectors([0, 0, 0])),
                *(GAP_M, MARGIN_M, RELEASE_M, STICK_M, friction),
            ],
            [moves := make_moves(3 * parallel), before, place],
        )
        launch.find()
        for _ in range(steps):
            launch.launch()
            wp.launch(make_all_moves, dim=len(moves.weight), inputs=[moves, before, place])
        return place.numpy()[:, 2], before.numpy()[:, 2]

    return run


def test_a_triangle_is_held_above_the_skin_that_it_has_come_down_on(lift):
    """Its middle is; corners of less mass go further."""
    now, then = lift(-0.002, then=0.004)
    assert now.mean() == pytest.approx(GAP_M, abs=1e-6)
    assert (np.diff(now) > 0).all()
    np.testing.assert_allclose(then, 0.004, atol=1e-7)


def test_one_that_was_too_low_before_comes_up_slowly_and_without_speed(lift):
    now, then = lift(-0.002)
    assert -0.002 < now.mean() < -0.001
    np.testing.assert_allclose(now, then, atol=1e-7)
    now, _ = lift(-0.002, steps=40)
    assert now.mean() == pytest.approx(GAP_M, abs=1e-6)


@pytest.mark.parametrize(
    "case",
    [
        {"height": 0.005},
        {"height": -0.02},
        {"height": -0.002, "faces": (0, 2, 1)},
        {"height": -0.002, "joint": "left_hand"},
    ],
    ids=["high enough", "far beneath", "the other way round", "over a hand"],
)
def test_others_stay_where_they_are(lift, case):
    now, _ = lift(**case)
    np.testing.assert_array_equal(now, np.float32(case["height"]))


def test_a_ball_smaller_than_the_meshes_of_a_sheet_does_not_show_through_it(
    tmp_path, device, parallel
):
    radius_m = 0.03
    ball = trimesh.creation.icosphere(subdivisions=3, radius=radius_m)
    up = ball.vertices[:, 2] > 0.5 * radius_m
    shown = []
    for margin_m in (1e-9, MARGIN_M):
        piece = sheet(radius_m + 0.005, rows=7, edge_m=0.06)
        solver = XpbdCloth(XpbdSettings(cover_margin_m=margin_m), device, parallel)
        (cloth,) = drop(tmp_path, solver, [piece], 12, radius=radius_m)
        covered = rays_hit(
            ball.vertices[up], ball.vertex_normals[up], cloth[-1], triangulate(piece.faces),
            reach_m=0.1,
        )  # fmt: skip
        shown.append(1 - covered.mean())
    assert shown[0] > 0.3
    assert shown[1] < 0.1
