import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices
from drapeline.bodies.overlap import measure_overlap
from drapeline.frames import JOINT_NAMES


@pytest.fixture
def folded(toy_body):
    """(4, V, 3) a body whose left hand is in its right thigh in the first frame."""
    vertices = posed_vertices(toy_body, np.zeros(10), np.zeros((4, 72)))[0]
    hand, thigh = (
        np.flatnonzero(toy_body.segmentation == JOINT_NAMES.index(name))
        for name in ("left_hand", "right_hip")
    )
    vertices[0, hand] += vertices[0, thigh].mean(axis=0) - vertices[0, hand].mean(axis=0)
    return vertices, hand


def everything(body):
    return np.ones(len(body.v_template), dtype=bool)


def test_a_body_at_rest_does_not_overlap(toy_body):
    vertices = posed_vertices(toy_body, np.zeros(10), np.zeros((1, 72)))[0]
    assert measure_overlap(toy_body, vertices, everything(toy_body)) == (0, 0)


def test_a_hand_in_a_thigh_counts_in_its_frame(toy_body, folded):
    vertices, hand = folded
    alone = measure_overlap(toy_body, vertices[:1], everything(toy_body))
    both = measure_overlap(toy_body, vertices, everything(toy_body))
    assert alone.share > 0.5 * len(hand) / len(toy_body.v_template)
    assert alone.depth_m > 0.03
    assert both.share == pytest.approx(alone.share / 2)  # the first and the fourth frame
    assert both.depth_m == alone.depth_m


def test_what_takes_no_part_does_not_count(toy_body, folded):
    vertices, _ = folded
    arm = [JOINT_NAMES.index(f"left_{name}") for name in ("elbow", "wrist", "hand")]
    collides = ~np.isin(toy_body.segmentation, arm)
    assert measure_overlap(toy_body, vertices[:1], collides) == (0, 0)
