import numpy as np
import pytest

from drapeline.rendering.camera import look_at
from drapeline.rendering.modalities import cast_rays


@pytest.fixture
def camera():
    """At x = 5, looking along -X, as CLOTH3D's."""
    return look_at(
        np.array([5.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0]), focal_px=100, size=(64, 48)
    )


def wall(x, half=0.8, velocity=(0.0, 0.0, 0.0)):
    """A square across the view at the given x, facing +X."""
    corners = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    vertices = np.column_stack([np.full(4, x), corners[:, 0], corners[:, 1] + 1.0])
    return vertices, np.array([[0, 1, 2, 3]]), np.tile(velocity, (4, 1))


def test_a_wall_has_its_distance_everywhere_and_faces_the_camera(camera):
    seen = cast_rays([wall(1.0, half=9.0, velocity=(0.0, 2.0, -1.0))], camera)
    np.testing.assert_allclose(seen.depth, 4.0, atol=1e-5)
    np.testing.assert_allclose(seen.normals, np.broadcast_to([1.0, 0, 0], (48, 64, 3)), atol=1e-6)
    np.testing.assert_allclose(
        seen.carried, np.broadcast_to([0, 2.0, -1.0], (48, 64, 3)), atol=1e-5
    )
    assert (seen.segments == 1).all()


def test_the_nearer_mesh_hides_the_other_and_outside_is_nothing(camera):
    seen = cast_rays([wall(0.0, half=0.6), wall(2.0, half=0.2)], camera)
    assert seen.segments[24, 32] == 2
    assert seen.segments[24, 32 + 9] == 1
    assert seen.segments[0, 0] == 0
    assert seen.depth[0, 0] == 0
    assert seen.depth[24, 32] == pytest.approx(3.0, abs=1e-5)


def test_vertices_project_onto_their_own_segment_and_depth(camera):
    vertices, faces, velocity = wall(0.5, half=0.7)
    seen = cast_rays([(vertices, faces, velocity)], camera)
    inside = 0.9 * (vertices - vertices.mean(0)) + vertices.mean(0)
    where, depth = camera.project(inside)
    for (u, v), distance in zip(where, depth, strict=True):
        assert seen.segments[int(v), int(u)] == 1
        assert seen.depth[int(v), int(u)] == pytest.approx(distance, abs=1e-5)
    rows, columns = np.nonzero(seen.segments)
    edge = np.abs(where - [32, 24]).max(0) / 0.9
    assert np.abs(columns + 0.5 - 32).max() <= edge[0]
    assert np.abs(rows + 0.5 - 24).max() <= edge[1]


def test_normals_point_to_the_camera_whichever_way_the_face_turns(camera):
    vertices, faces, velocity = wall(0.0)
    seen = cast_rays([(vertices, faces[:, ::-1].copy(), velocity)], camera)
    assert seen.normals[24, 32, 0] == pytest.approx(1.0)
