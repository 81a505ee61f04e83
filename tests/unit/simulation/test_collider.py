import numpy as np
import pytest
import trimesh

from drapeline.bodies.model import posed_vertices
from drapeline.frames import JOINT_NAMES, REST_POSE
from drapeline.geometry.coarsen import coarsen_faces
from drapeline.geometry.point_cache import PointCache, write_point_cache
from drapeline.simulation.collider import (
    MovingBody,
    make_collider,
    reachable_vertices,
)


@pytest.fixture(scope="module")
def ball():
    return trimesh.creation.icosphere(subdivisions=4)


def test_a_ball_stays_a_closed_ball_of_fewer_triangles(ball):
    faces = coarsen_faces(ball.vertices, ball.faces, 0.3)
    assert len(faces) == pytest.approx(0.3 * len(ball.faces), rel=0.02)
    coarse = trimesh.Trimesh(ball.vertices, faces, process=False)
    assert coarse.is_watertight
    # Corners lie on the ball, so its volume is a little smaller and outward.
    assert 0.98 * ball.volume < coarse.volume < ball.volume


def test_vertices_without_faces_are_never_corners(ball):
    apart = np.concatenate([np.zeros((7, 3)), ball.vertices])
    faces = coarsen_faces(apart, ball.faces + 7, 0.5)
    assert faces.min() >= 7
    moved = faces - 7
    assert np.array_equal(moved, coarsen_faces(ball.vertices, ball.faces, 0.5))


def test_an_open_edge_stays_open(ball):
    half = ball.faces[(ball.triangles_center[:, 2] < 0)]
    faces = coarsen_faces(ball.vertices, half, 0.5)
    assert ball.vertices[faces][:, :, 2].max() < 0.1
    assert len(trimesh.Trimesh(ball.vertices, faces, process=False).outline().entities) == 1


def test_the_whole_body_is_kept_as_it_is(ball):
    assert coarsen_faces(ball.vertices, ball.faces, 1.0) is ball.faces


def test_a_boundary_that_touches_itself_is_kept_as_it_is(ball):
    """Two caps that share one vertex: no manifold, so nothing may contract there."""
    top = int(ball.vertices[:, 2].argmax())
    vertices = np.concatenate([ball.vertices, -ball.vertices + 2 * ball.vertices[top]])
    cap = ball.faces[ball.triangles_center[:, 2] > 0.5]
    other = cap[:, ::-1] + len(ball.vertices)
    other[other == top + len(ball.vertices)] = top
    faces = np.concatenate([cap, other])
    found = coarsen_faces(vertices, faces, 0.5)
    assert len(found)
    assert np.isin(found, faces).all()


def hands(body):
    return np.isin(body.segmentation, [JOINT_NAMES.index(f"{s}_hand") for s in ("left", "right")])


@pytest.fixture
def vest(toy_body):
    """Cloth right on the trunk."""
    rest = posed_vertices(toy_body, np.zeros(10), REST_POSE[None].copy())[0][0]
    trunk = [JOINT_NAMES.index(name) for name in ("spine1", "spine2", "spine3")]
    return rest, rest[np.isin(toy_body.segmentation, trunk)]


def test_hands_head_and_feet_far_from_a_vest_do_not_collide(toy_body, vest):
    rest, cloth = vest
    kept = reachable_vertices(toy_body.segmentation, [rest], [cloth])
    ends = [JOINT_NAMES.index(n) for n in ("head", "left_hand", "right_hand", "left_foot")]
    assert not kept[np.isin(toy_body.segmentation, ends)].any()
    assert kept[np.isin(toy_body.segmentation, [0, 3, 6, 9, 16, 17])].all()


def test_a_hand_that_comes_near_in_any_frame_collides(toy_body, vest):
    rest, cloth = vest
    near = rest.copy()
    left = toy_body.segmentation == JOINT_NAMES.index("left_hand")
    near[left] += cloth.mean(axis=0) + [0, -0.2, 0] - rest[left].mean(axis=0)
    kept = reachable_vertices(toy_body.segmentation, [rest] * 5 + [near], [cloth])
    assert kept[left].all()
    assert not kept[hands(toy_body) & ~left].any()


def test_a_sleeve_over_the_hand_keeps_the_hand(toy_body, vest):
    rest, cloth = vest
    kept = reachable_vertices(toy_body.segmentation, [rest], [cloth, rest[hands(toy_body)]])
    assert kept[hands(toy_body)].all()


@pytest.fixture
def walking(toy_body, vest, tmp_path):
    rest, _ = vest
    frames = [rest + np.float32([0, 0.1 * k, 0]) for k in range(3)]
    write_point_cache(tmp_path / "body.pc2", frames)
    with PointCache(tmp_path / "body.pc2") as cache:
        yield MovingBody(cache, toy_body.faces, toy_body.segmentation), frames


def test_a_moving_body_is_read_frame_by_frame(walking):
    body, frames = walking
    assert len(body) == 3
    np.testing.assert_array_equal(body.frame(1), frames[1])
    for read, written in zip(body, frames, strict=True):
        np.testing.assert_array_equal(read, written)


def test_what_is_published_is_relative_to_the_root_and_in_half_precision(walking, tmp_path):
    body, frames = walking
    np.testing.assert_array_equal(body.publish(frames[1], 1), frames[1])
    roots = np.float32([[0, 0, 0], [0.1, 0.2, 0.3], [1, 2, 3]])
    with PointCache(tmp_path / "body.pc2") as cache:
        rooted = MovingBody(cache, body.faces, body.segments, roots=roots)
        part = rooted.restrict(body.faces[::2])
    for index, frame in enumerate(frames):
        exact = frame - roots[index]
        published = part.publish(frame, index)
        np.testing.assert_array_equal(published, published.astype(np.float16))
        np.testing.assert_allclose(published, exact, rtol=2**-11, atol=2**-25)


def test_a_part_of_a_part_keeps_places_faces_and_segments(walking):
    body, frames = walking
    half = body.restrict(body.faces[::2])
    quarter = half.restrict(half.faces[::2])
    wanted = body.faces[::4]
    assert quarter.faces.max() + 1 == len(np.unique(wanted)) == len(quarter.segments)
    np.testing.assert_array_equal(quarter.frame(2)[quarter.faces], frames[2][wanted])
    np.testing.assert_array_equal(quarter.segments[quarter.faces], body.segments[wanted])


def test_the_collider_is_what_cloth_reaches_of_fewer_triangles(walking, vest, toy_body):
    body, frames = walking
    _, cloth = vest
    collider = make_collider(body, [cloth], 1.0)
    kept = reachable_vertices(body.segments, frames, [cloth])
    assert len(collider.faces) == kept[body.faces].all(axis=1).sum()
    assert not np.isin(collider.segments, [JOINT_NAMES.index("head")]).any()
    coarse = make_collider(body, [cloth], 0.5)
    assert len(coarse.faces) == pytest.approx(0.5 * len(collider.faces), rel=0.02)
    assert {tuple(v) for v in coarse.frame(1).tolist()} <= {tuple(v) for v in frames[1].tolist()}
