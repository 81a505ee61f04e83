"""Metrics of garments in motion."""

from types import SimpleNamespace

import numpy as np
import pytest

from drapeline.bodies.rest_body import rest_body, rest_to_pose
from drapeline.bodies.skinning import skin_points
from drapeline.metrics.dynamic import Measured, measure_motion, moving_summary
from drapeline.metrics.table import HIGH, LOW, find_value
from toys.moving import moving_garment


@pytest.fixture(scope="module")
def topology(toy_body):
    return SimpleNamespace(faces=toy_body.faces, faces_of=lambda name: toy_body.faces)


def test_a_perfect_prediction_has_no_error_and_is_outside(toy_body, topology):
    moving = moving_garment(toy_body, "test", "Tshirt")
    frames = np.array([1, 4])
    rows = measure_motion(moving, frames, moving.points(frames), toy_body, topology)
    assert [row["surface_error_mm"] for row in rows] == [0, 0]
    assert rows[0]["inside_1cm_share"] == 0
    assert "inside_share" not in rows[1]  # only every fifth frame


def test_cloth_inside_the_body_is_seen_in_its_pose(toy_body, topology):
    moving = moving_garment(toy_body, "test", "Tshirt")
    frames = np.array([3])
    body = rest_body(toy_body, moving.shape)[moving.registered.vertex]
    inside = skin_points(
        body * [0.7, 0.7, 1],
        rest_to_pose(toy_body, moving.shape, moving.poses[frames]),
        moving.registered.weights,
    )
    (row,) = measure_motion(moving, frames, inside, toy_body, topology)
    assert row["inside_1cm_share"] > 0.8
    assert row["surface_error_mm"] > 20


def test_frames_of_one_sample_make_no_interval_narrower():
    names = {"model": "dvae", "variant": "v", "split": "test", "seed": 0}

    def width(copies):
        measured = [
            Measured(f"s{k}", "Top", "blender", [{"surface_error_mm": value}] * copies)
            for k, value in enumerate((1.0, 2.0, 5.0, 9.0))
        ]
        rows = moving_summary(measured, **names)
        low, high = (
            find_value(rows, "v", "test", "all", "surface_error_mm" + end) for end in (LOW, HIGH)
        )
        assert low.n == 4 * copies
        return high.value - low.value

    assert width(50) == pytest.approx(width(1))
    assert width(1) > 3


def test_samples_of_several_solvers_have_rows_of_their_own_besides_those_of_all():
    names = {"model": "dvae", "variant": "v", "split": "test", "seed": 0}
    values = (("blender", 1.0), ("xpbd", 2.0), ("xpbd", 6.0))
    measured = [
        Measured(f"s{k}", "Top", source, [{"surface_error_mm": value}])
        for k, (source, value) in enumerate(values)
    ]
    rows = moving_summary(measured, **names)
    found = {
        source: find_value(rows, "v", "test", "all", "surface_error_mm", source)
        for source in ("", "blender", "xpbd")
    }
    assert {source: (row.value, row.n) for source, row in found.items()} == {
        "": (3.0, 3),
        "blender": (1.0, 1),
        "xpbd": (4.0, 2),
    }
    alone = moving_summary(measured[1:], **names)
    assert {row.source for row in alone} == {""}
