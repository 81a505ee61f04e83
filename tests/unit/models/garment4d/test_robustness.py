"""Worse inputs than those that models learned from."""

import numpy as np
import pytest

from drapeline.models.garment4d.robustness import UNDEGRADED, degraded
from drapeline.models.garment4d.settings import EvaluationSettings

SETTINGS = EvaluationSettings(
    missing=(0.5,),
    accuracy=(0.7,),
    body_noise_rad=(0.05, 0.1),
    point_noise_m=(0.01,),
    views=(1,),
    frame_rates=(),
)


@pytest.fixture
def found(sequences):
    sequence = int(sequences.data.of_split("test")[0])
    return {one.name: one.seen for one in degraded(sequences, sequence, SETTINGS)}, sequence


def test_one_kind_of_input_is_worse_at_a_time(found, sequences):
    cases, sequence = found
    plain = sequences.seen(sequence)
    assert list(cases) == [
        *(UNDEGRADED, "missing_50", "accuracy_70", "body_noise_50", "body_noise_100"),
        *("point_noise_10", "views_1"),
    ]
    for name, seen in cases.items():
        same = {
            "points": np.array_equal(seen.points, plain.points),
            "poses": np.array_equal(seen.poses, plain.poses),
            "labels": seen.labels is None,
        }
        kind = name.rpartition("_")[0]
        worse = {"accuracy": "labels", "body_noise": "poses", "": None}.get(kind, "points")
        assert [key for key, value in same.items() if not value] == ([worse] if worse else [])
        assert seen.points.shape == plain.points.shape
        assert seen.points.dtype == np.float32


def test_fewer_frames_are_those_at_even_steps(sequences):
    sequence = int(sequences.data.of_split("test")[0])
    plain = sequences.seen(sequence)
    settings = SETTINGS.replace(frame_rates=(15, 10))
    *_, half, third = degraded(sequences, sequence, settings)
    for one, name, step in ((half, "frame_rate_15", 2), (third, "frame_rate_10", 3)):
        assert (one.name, one.step) == (name, step)
        np.testing.assert_array_equal(one.seen.points, plain.points[::step])
        np.testing.assert_array_equal(one.seen.poses, plain.poses[::step])
        np.testing.assert_array_equal(one.seen.trans, plain.trans[::step])


def test_labels_are_right_as_often_as_asked(found, sequences):
    cases, sequence = found
    true = sequences.data.labels[sequences.data.rows(sequence)]
    assert (cases["accuracy_70"].labels == true).mean() == pytest.approx(0.7, abs=0.01)


def test_holes_and_cameras_leave_points_out_and_repeat_others(found, sequences):
    cases, sequence = found
    for name in ("missing_50", "views_1"):
        for frame, whole in zip(cases[name].points, sequences.seen(sequence).points, strict=True):
            left = {*map(tuple, frame)}
            assert left < {*map(tuple, whole)}


def test_bodies_are_off_by_the_same_in_all_frames_and_in_all_strengths(found, sequences):
    cases, sequence = found
    plain = sequences.seen(sequence)
    little, much = (cases[f"body_noise_{k}"].poses - plain.poses for k in (50, 100))
    np.testing.assert_allclose(little, np.broadcast_to(little[:1], little.shape), atol=1e-6)
    np.testing.assert_allclose(2 * little, much, atol=1e-6)
    assert 0.03 < little[0].std() < 0.07
    assert cases["body_noise_50"].body.shape != pytest.approx(plain.body.shape)


def test_noise_is_as_large_as_asked(found, sequences):
    cases, sequence = found
    away = cases["point_noise_10"].points - sequences.seen(sequence).points
    assert away.std() == pytest.approx(0.01, rel=0.1)
