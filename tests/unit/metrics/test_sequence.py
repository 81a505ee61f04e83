"""Metrics of reconstructed sequences against motions whose answer is known."""

import numpy as np
import pytest

from drapeline.geometry.mesh import Mesh
from drapeline.metrics.garment import CONTACT_STEP
from drapeline.metrics.sequence import (
    BodyFrames,
    acceleration_error_m_s2,
    canonical_measures,
    inside_means,
    motion_spectrum,
    segmentation_accuracy,
    sequence_measures,
    split_error_mm,
    to_cloud_mm,
    velocity_error_m_s,
    vertex_error_mm,
    vertex_errors_mm,
)
from drapeline.seeding import rng_for


@pytest.fixture
def motion():
    """(8, 30, 3) smooth motion of a random cloud."""
    rng = rng_for(0, "garment4d motion")
    steps = np.arange(8)[:, None, None]
    return (rng.normal(size=(30, 3)) + 0.1 * np.sin(0.4 * steps + rng.normal(size=3))).astype(
        np.float32
    )


def ball(radius):
    """A finely cut octahedral sphere: vertices and outward triangles."""
    vertices = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    faces = np.array(
        [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    )
    vertices = vertices.astype(float)
    for _ in range(3):
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        corners = np.stack([a, b, c, (a + b) / 2, (b + c) / 2, (c + a) / 2], 1).reshape(-1, 3)
        start = 6 * np.arange(len(faces))[:, None]
        parts = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]
        faces = np.concatenate([start + part for part in parts])
        vertices, same = np.unique(corners.round(9), axis=0, return_inverse=True)
        faces = same.reshape(-1)[faces]
    return radius * vertices / np.linalg.norm(vertices, axis=1, keepdims=True), faces


def test_vertex_errors_are_lengths(motion):
    shift = np.array([0.003, 0.0, 0.004])
    assert vertex_error_mm(motion + shift, motion) == pytest.approx(5.0)
    assert vertex_error_mm(motion[0] + shift, motion[0]) == pytest.approx(5.0)
    one = motion.copy()
    one[2, 7] += shift
    errors = vertex_errors_mm(one, motion)
    assert errors.shape == (8, 30)
    assert errors[2, 7] == pytest.approx(5.0, rel=1e-4)
    assert vertex_error_mm(one, motion) == pytest.approx(5.0 / 240, rel=1e-4)


def test_every_frame_of_a_sequence_counts_once(motion):
    rng = rng_for(0, "garment4d error")
    predicted = motion + rng.normal(0, 0.01, motion.shape)
    parts = [vertex_error_mm(predicted[a:b], motion[a:b]) for a, b in ((0, 5), (5, 8))]
    assert vertex_error_mm(predicted, motion) == pytest.approx((5 * parts[0] + 3 * parts[1]) / 8)


def test_acceleration_of_a_parabola_and_of_drift(motion):
    seconds = np.arange(len(motion))[:, None, None] / 30
    fall = motion + np.array([0.0, 0.0, -9.81]) / 2 * seconds**2
    assert acceleration_error_m_s2(fall, motion) == pytest.approx(9.81, rel=1e-4)
    drift = motion + np.array([1.0, 2.0, 3.0]) * seconds + 5
    assert acceleration_error_m_s2(drift, motion) == pytest.approx(0, abs=1e-3)
    # Positions passed through twice as fast: four times the acceleration.
    faster = acceleration_error_m_s2(fall[::2], motion[::2])
    assert faster == pytest.approx(4 * 9.81, rel=1e-4)


def test_acceleration_equals_a_loop_over_vertices(motion):
    predicted = motion + rng_for(0, "garment4d jitter").normal(0, 0.01, motion.shape)
    lengths = []
    for frame in range(1, len(motion) - 1):
        for vertex in range(motion.shape[1]):
            a, b = (
                900 * (m[frame - 1, vertex] - 2.0 * m[frame, vertex] + m[frame + 1, vertex])
                for m in (predicted, motion.astype(float))
            )
            lengths.append(np.sqrt(((a - b) ** 2).sum()))
    assert acceleration_error_m_s2(predicted, motion) == pytest.approx(np.mean(lengths))


def test_acceleration_has_no_meaning_for_two_frames(motion):
    assert np.isnan(acceleration_error_m_s2(motion[:2] + 1, motion[:2]))


def test_one_way_distance_is_that_of_the_slow_twin_and_looks_one_way(motion):
    rng = rng_for(0, "garment4d cloud")
    clouds = [rng.normal(size=(40 + 5 * k, 3)) for k in range(len(motion))]
    slow = [
        np.linalg.norm(garment[:, None] - cloud[None], axis=-1).min(axis=1).mean()
        for garment, cloud in zip(motion, clouds, strict=True)
    ]
    assert to_cloud_mm(motion, clouds) == pytest.approx(1000 * np.mean(slow), rel=1e-5)
    more = [np.concatenate([garment, garment + 50]) for garment in motion]
    assert to_cloud_mm(motion, more) == 0


def test_velocity_errors_are_those_of_what_moves_and_should_not(motion):
    # 3 mm per frame too fast, whatever the true motion is.
    drift = 0.003 * np.arange(len(motion))[:, None, None] * np.array([0.0, 1.0, 0.0])
    assert velocity_error_m_s(motion + drift, motion) == pytest.approx(0.09, rel=1e-4)
    assert velocity_error_m_s(motion + 0.5, motion) == pytest.approx(0, abs=1e-4)
    assert np.isnan(velocity_error_m_s(motion[:1], motion[:1]))


def test_errors_fall_apart_into_those_off_the_surface_and_along_it():
    vertices, faces = ball(0.3)
    true = np.stack([vertices, vertices + 1])
    wider = np.stack([1.1 * vertices, 1.1 * vertices + 1])
    found = split_error_mm(wider, true, faces)
    assert found["off_surface_mm"] == pytest.approx(30, rel=0.01)
    assert found["along_surface_mm"] < 1
    turn = 0.05
    turned = vertices @ np.array(
        [[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    )
    found = split_error_mm(np.stack([turned, turned + 1]), true, faces)
    wanted = 1000 * turn * np.linalg.norm(vertices[:, :2], axis=1).mean()
    assert found["along_surface_mm"] == pytest.approx(wanted, rel=0.01)
    assert found["off_surface_mm"] < 0.05 * wanted


def test_clouds_must_be_as_many_as_frames(motion):
    with pytest.raises(ValueError, match="shorter"):
        to_cloud_mm(motion, motion[:3])


def test_accuracy_is_the_share_of_right_labels():
    true = np.array([[0, 1, 2, 1], [0, 0, 0, 1]], dtype=np.uint8)
    predicted = true.copy()
    predicted[0, 2] = predicted[1, 3] = 3
    assert segmentation_accuracy(predicted, true) == pytest.approx(0.75)


def test_inside_means_are_those_of_the_looked_at_frames():
    body, faces = ball(0.2)
    asked = []

    def vertices(frame):
        asked.append(frame)
        return body + [0, 0, frame]

    outside, deep = body[:20] * 1.2, body[:20] * 0.75
    garment = np.stack([deep + [0, 0, k] if k < 5 else outside + [0, 0, k] for k in range(10)])
    found = inside_means(garment, BodyFrames(vertices, faces))
    assert asked == [0, CONTACT_STEP]
    assert found["inside_share"] == pytest.approx(0.5)
    assert found["inside_1cm_share"] == pytest.approx(0.5)
    assert found["inside_depth_mm"] == pytest.approx(25, abs=1.0)


def test_sequence_measures_follow_what_is_known(motion):
    vertices, faces = ball(0.05)
    body = BodyFrames(lambda frame: vertices, faces)
    assert set(sequence_measures(motion, motion)) == {
        "vertex_error_mm",
        "velocity_error_m_s",
        "acceleration_error_m_s2",
        *("slow_motion", "quick_motion", "fast_motion"),
    }
    assert set(sequence_measures(motion, points=motion)) == {"to_cloud_mm"}
    found = sequence_measures(motion + 0.01, motion, body=body, points=motion)
    assert found["vertex_error_mm"] == pytest.approx(np.sqrt(300), rel=1e-4)
    assert 0 < found["to_cloud_mm"] <= found["vertex_error_mm"] + 1e-9
    assert {"inside_share", "inside_1cm_share", "inside_depth_mm"} < set(found)


def test_canonical_error_is_also_taken_against_the_garment_as_made():
    original = Mesh(*ball(0.3))
    true = ball(0.31)[0]  # registration that loses a centimetre
    found = canonical_measures(Mesh(*ball(0.33)), true, original)
    assert found["canonical_error_mm"] == pytest.approx(20, abs=0.01)
    assert found["canonical_to_original_mm"] == pytest.approx(30, abs=1.5)
    assert set(canonical_measures(Mesh(*ball(0.31)), true)) == {"canonical_error_mm"}
    floor = canonical_measures(Mesh(*ball(0.31)), None, original)
    assert floor == {"canonical_to_original_mm": pytest.approx(10, abs=1.5)}


def test_sliding_along_a_plane_is_no_distance_between_surfaces():
    across = np.linspace(0, 1, 11)
    grid = np.stack([*np.meshgrid(across, across), np.zeros((11, 11))], axis=-1).reshape(-1, 3)
    corner = np.arange(121).reshape(11, 11)[:-1, :-1].ravel()
    faces = np.concatenate([corner[:, None] + [0, 1, 12], corner[:, None] + [0, 12, 11]]).astype(
        np.int32
    )
    true = np.stack([grid] * 3)
    lifted = sequence_measures(true + [0, 0, 0.004], true, faces=faces)
    assert lifted["predicted_to_true_mm"] == pytest.approx(4, abs=1e-3)
    assert lifted["true_to_predicted_mm"] == pytest.approx(4, abs=1e-3)
    # Within the plane only what leaves the square is away from it: the last column, by 5 cm.
    slid = sequence_measures(true + [0.05, 0, 0], true, faces=faces)
    assert slid["vertex_error_mm"] == pytest.approx(50)
    assert slid["predicted_to_true_mm"] == pytest.approx(50 / 11, abs=1e-3)


def test_motion_is_told_apart_by_its_speed():
    """Half of the true motion at 1 Hz, twice as much at 8 Hz, none between."""
    time = np.arange(90)[:, None, None] / 30
    ways = np.random.default_rng(0).normal(size=(2, 1, 5, 3))
    slow, fast = (way * np.sin(2 * np.pi * f * time) for way, f in zip(ways, (1, 8), strict=True))
    found = motion_spectrum(0.5 * slow + 2 * fast, slow + fast)
    assert found["slow_motion"] == pytest.approx(0.5, rel=1e-3)
    assert found["fast_motion"] == pytest.approx(2, rel=1e-3)
    assert motion_spectrum(np.zeros_like(slow), slow)["slow_motion"] == 0
    assert np.isnan(motion_spectrum(slow, np.zeros_like(slow))["slow_motion"])
