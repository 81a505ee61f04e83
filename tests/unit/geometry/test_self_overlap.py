import igl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.bodies.model import posed_vertices
from drapeline.frames import JOINT_NAMES
from drapeline.geometry.mesh import faces_within, vertex_normals
from drapeline.geometry.self_overlap import SelfOverlap
from toys.bodies import toy_body

RADIUS_M = 0.1


def ball(centre):
    around, up = np.meshgrid(np.arange(48) / 48 * 2 * np.pi, np.linspace(0, np.pi, 26)[1:-1])
    sides = np.stack([np.sin(up) * np.cos(around), np.sin(up) * np.sin(around), np.cos(up)], axis=2)
    vertices = np.concatenate([sides.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]])
    cells = np.arange(24 * 48).reshape(24, 48)
    a, b = cells[:-1], np.roll(cells, -1, axis=1)[:-1]
    c, d = cells[1:], np.roll(cells, -1, axis=1)[1:]
    top = [np.full(48, 1152), cells[0], np.roll(cells[0], -1)]
    end = [np.full(48, 1153), np.roll(cells[-1], -1), cells[-1]]
    faces = [np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, c, d), (a, d, b))]
    faces += [np.stack(corners, axis=1) for corners in (top, end)]
    return centre + RADIUS_M * vertices, np.concatenate(faces)


def two_balls(apart_m, way):
    (first, faces), (second, _) = ball(np.zeros(3)), ball(apart_m * np.array(way))
    vertices = np.concatenate([first, second]).astype(np.float32)
    groups = np.repeat([0, 1], len(first))
    return vertices, np.concatenate([faces, faces + len(first)]), groups


@pytest.mark.parametrize("way", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.48, 0.6, 0.64)])
def test_what_is_inside_another_ball_is_found_with_its_depth(way):
    vertices, faces, groups = two_balls(0.15, way)
    inside, depths = SelfOverlap(faces, groups)(vertices)
    centres = np.array([0.15 * np.array(way), np.zeros(3)])[groups]
    deep = RADIUS_M - np.linalg.norm(vertices - centres, axis=1)
    assert set(np.flatnonzero(deep > 0.001)) <= set(inside) <= set(np.flatnonzero(deep > -0.001))
    assert depths == pytest.approx(deep[inside], abs=0.004)
    assert depths.max() == pytest.approx(0.05, abs=0.004)


def test_balls_that_are_apart_have_nothing_inside():
    vertices, faces, groups = two_balls(0.203, (0.48, 0.6, 0.64))
    assert not len(SelfOverlap(faces, groups)(vertices)[0])


def test_a_small_ball_within_another_is_deep_in_it():
    vertices, faces, groups = two_balls(0.01, (1, 0, 0))
    vertices[groups == 1] *= 0.1
    inside, depths = SelfOverlap(faces, groups)(vertices)
    assert inside.tolist() == np.flatnonzero(groups == 1).tolist()
    assert depths.min() > 0.07


def bent(joints, angle_rad):
    body = toy_body()
    poses = np.zeros((1, 24, 3))
    for joint, axis in joints.items():
        poses[0, JOINT_NAMES.index(joint), axis] = angle_rad
    poses[0, 0] = Rotation.from_euler("xyz", [0.3, 0.5, 0.2]).as_rotvec()
    return body, posed_vertices(body, np.zeros(10), poses.reshape(1, 72))[0][0]


@pytest.mark.parametrize(
    "joints",
    [
        {"left_elbow": 1, "right_knee": 0},
        {"left_shoulder": 2, "right_shoulder": 1},
        {"left_hip": 0, "spine1": 0, "spine2": 0},
    ],
)
def test_bent_bodies_have_inside_what_generalised_winding_numbers_say(joints):
    body, vertices = bent(joints, 2.4)
    inside, _ = SelfOverlap(body.faces, body.segmentation)(vertices)
    places = vertices + 1e-4 * vertex_normals(vertices, body.faces)
    windings = igl.winding_number(
        vertices.astype(np.float64), body.faces.astype(np.int64), places.astype(np.float64)
    )
    expected = np.flatnonzero(windings > 0.5)
    assert len(expected) > 10
    assert inside.tolist() == expected.tolist()


def test_a_hand_that_is_left_out_overlaps_nothing():
    body, folded = bent({"left_elbow": 1}, 2.9)
    hands = [JOINT_NAMES.index(f"left_{name}") for name in ("wrist", "hand")]
    kept = ~np.isin(body.segmentation, hands)
    whole = SelfOverlap(body.faces, body.segmentation)(folded)[0]
    part = SelfOverlap(faces_within(body.faces, kept), body.segmentation)(folded)[0]
    assert not np.isin(body.segmentation[part], hands).any()
    assert len(part) < np.isin(whole, np.flatnonzero(kept)).sum()
