"""Which frame of a rejected sample is kept, and what in it is marked."""

import numpy as np
import pytest
import trimesh

from drapeline.bodies.model import posed_vertices
from drapeline.dataset.record import EXTRAS
from drapeline.dataset.worst_frame import find_worst_frame, read_worst_frame, write_worst_frame
from drapeline.frames import JOINT_NAMES, REST_POSE
from drapeline.geometry.point_cache import write_point_cache
from drapeline.outfits.outfit import Garment
from toys.bodies import toy_body
from toys.sheets import sheet

NAN = np.nan


@pytest.mark.parametrize(
    ("reason", "frame"),
    [
        ("inside_open_mean 0.02, expected at most 0.01", 2),
        ("stretch_low 0.5, expected at least 0.75; slip_m 1, expected at most 0.25", 0),
        ("stretch_high 2, expected at most 1.25", 3),
        ("acceleration_m_s2 900, expected at most 1", 1),
        ("a vertex is not finite", 3),
    ],
)
def test_a_frame_is_the_worst_by_what_the_reason_begins_with(reason, frame):
    health = {
        "inside_share": np.array([[0, 0.1], [0, 0], [0, 0], [0, 0.2]]),
        "inside_open_share": np.array([[0, 0.1], [0, 0], [0.3, 0], [0, 0.2]]),
        "stretch_p01": np.array([[0.5, 1], [0.9, 0.9], [0.8, 0.7], [1, 1]]),
        "stretch_p99": np.array([[1, 1], [1.1, 1], [1, 1.2], [1, 1.3]]),
        "acceleration_m_s2": np.array([[NAN, NAN], [3, 9], [5, 5], [NAN, NAN]]),
    }
    assert find_worst_frame(health, reason) == frame


REST = posed_vertices(toy_body(), np.zeros(10), REST_POSE[None])[1][0]
JOINTS = REST + [2.0, 0, 0]  # of a person beside the ball


def flat(height):
    piece = sheet(height, rows=5, edge_m=0.1)
    uv = np.zeros((1, 2), np.float32)
    corners = np.zeros_like(piece.faces)
    masks = 3 * [np.zeros(25, np.float32)]
    return Garment("Top", piece.vertices, piece.faces, uv, corners, *masks, attributes={})


def marked(tmp_path, garment, frames, reason):
    ball = trimesh.creation.icosphere(radius=0.12)
    (tmp_path / EXTRAS).mkdir()
    write_point_cache(tmp_path / "Top.f32", np.float32(frames))
    body = ball.vertices.astype(np.float32)
    faces = ball.faces.astype(np.int32)
    turn = np.array([0.1, 0.2, 0.3])
    write_worst_frame(tmp_path, tmp_path, 1, reason, turn, body, JOINTS, REST, faces, [garment])
    worst = read_worst_frame(tmp_path)
    assert worst.frame == 1
    np.testing.assert_array_equal(worst.root_rotation, turn)
    np.testing.assert_array_equal(worst.body, body)
    vertices, _, wrong = worst.garments["Top"]
    np.testing.assert_array_equal(vertices, np.float32(frames)[1])
    return wrong


def test_vertices_inside_the_body_are_marked(tmp_path):
    garment = flat(0.0)
    frames = [garment.vertices + [0, 0, 1], garment.vertices]
    wrong = marked(tmp_path, garment, frames, "inside_open_mean 1, expected at most 0.01")
    np.testing.assert_array_equal(wrong, np.linalg.norm(garment.vertices, axis=1) < 0.11)


def test_ends_of_long_edges_are_marked(tmp_path):
    garment = flat(0.5)
    moved = garment.vertices.copy()
    moved[0] -= [0.1, 0.0, 0.0]
    wrong = marked(tmp_path, garment, [moved, moved], "stretch_high 2, expected at most 1.25")
    assert np.flatnonzero(wrong).tolist() == [0, 1, 5]


def test_edges_through_the_garment_are_marked(tmp_path):
    garment = flat(0.5)
    moved = garment.vertices.copy()
    moved[:2] = moved[12] + [[0.02, 0.01, -0.05], [0.02, 0.01, 0.05]]  # through the middle
    wrong = marked(tmp_path, garment, [moved, moved], "self_share_mean 1, expected at most 0.1")
    assert wrong[[0, 1, 12]].all()
    assert not wrong[24]


def test_rims_of_openings_that_lost_their_limb_are_marked(tmp_path):
    """A sheet around the neck, with the person beside it since."""
    garment = flat(float(REST[JOINT_NAMES.index("neck"), 2]) + 0.03)
    frames = [garment.vertices, garment.vertices]
    reason = "lost_openings 1, expected at most 0.1"
    wrong = marked(tmp_path, garment, frames, reason).reshape(5, 5)
    assert wrong.sum() == 16
    assert not wrong[1:-1, 1:-1].any()


def test_there_is_nothing_where_nothing_was_simulated(tmp_path):
    assert read_worst_frame(tmp_path) is None
