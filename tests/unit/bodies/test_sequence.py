"""A body in motion: its vertices, its collision faces, its file."""

from dataclasses import fields

import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices
from drapeline.bodies.sequence import (
    BodySequence,
    ClipLabels,
    body_sequence_vertices,
    collision_faces,
    first_frames,
    load_body_sequence,
    save_body_sequence,
)
from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES, REST_POSE


@pytest.fixture
def record():
    """Four frames, of which two have corrected vertices."""
    rng = np.random.default_rng(0)
    return BodySequence(
        shape=rng.uniform(-1, 1, 10),
        gender="male",
        poses=REST_POSE + rng.normal(0, 0.1, (4, 72)),
        trans=rng.normal(size=(4, 3)),
        outcome="removed",
        reason="",
        thinned=1,
        redrawn=2,
        removed_segments=np.array([JOINT_NAMES.index("left_hand")], dtype=np.int32),
        fix_frame=np.array([1, 1, 3], dtype=np.int32),
        fix_vertex=np.array([7, 9, 7], dtype=np.int32),
        fix_delta=np.eye(3, dtype=np.float32),
        collided_frames=2,
        deepest_m=0.01,
        overlap_share=0.004,
        overlap_depth_m=0.006,
        penetration_m=0.002,
        sliding_m_s=0.1,
        hover_s=0.2,
        flight_s=0.3,
        labels=ClipLabels("walk_s1", "walk", "7", "07_01.bvh", 30),
    )


def test_corrections_are_added_to_their_vertices_in_their_frames(toy_body, record):
    plain, _ = posed_vertices(toy_body, record.shape, record.poses)
    change = body_sequence_vertices(toy_body, record) - plain
    assert np.argwhere(np.abs(change).max(axis=2) > 1e-3).tolist() == [[1, 7], [1, 9], [3, 7]]
    np.testing.assert_allclose(change[[1, 1, 3], [7, 9, 7]], np.eye(3), atol=1e-6)


def test_slices_and_world_frame(toy_body, record):
    whole = body_sequence_vertices(toy_body, record, world=True)
    np.testing.assert_allclose(
        body_sequence_vertices(toy_body, record, world=True, frames=slice(1, 3)),
        whole[1:3],
        atol=1e-5,  # sums of matrix products depend on the number of rows
    )
    np.testing.assert_allclose(
        whole, body_sequence_vertices(toy_body, record) + record.trans[:, None], atol=1e-4
    )


@pytest.mark.parametrize("count", [1, 2, 99])
def test_the_first_frames_are_those_of_the_whole(toy_body, record, count):
    whole = body_sequence_vertices(toy_body, record, world=True)
    part = first_frames(record, count)
    assert len(part.poses) == len(part.trans) == min(count, len(record.poses))
    first = body_sequence_vertices(toy_body, part, world=True)
    np.testing.assert_allclose(first, whole[:count], atol=1e-5)


def test_cloth_does_not_collide_with_removed_segments(toy_body, record):
    kept = {tuple(face) for face in collision_faces(toy_body, record).tolist()}
    removed = toy_body.segmentation == JOINT_NAMES.index("left_hand")
    expected = {tuple(f) for f in toy_body.faces.tolist() if not removed[f].any()}
    assert kept == expected
    assert len(kept) < len(toy_body.faces)


def test_a_record_survives_its_file(record, tmp_path):
    save_body_sequence(tmp_path / "a.npz", record)
    back = load_body_sequence(tmp_path / "a.npz")
    assert back.labels == record.labels
    for field in fields(record):
        np.testing.assert_array_equal(getattr(back, field.name), getattr(record, field.name))
        assert type(getattr(back, field.name)) is type(getattr(record, field.name))


def test_labels_are_plain_keys_of_the_file(record, tmp_path):
    save_body_sequence(tmp_path / "a.npz", record)
    with np.load(tmp_path / "a.npz") as arrays:
        assert arrays["sequence"] == "walk_s1"
        assert arrays["start_frame"] == 30
        assert "labels" not in arrays


def test_a_file_without_a_field_is_refused(tmp_path):
    np.savez(tmp_path / "a.npz", shape=np.zeros(10))
    with pytest.raises(InputError, match="lacks"):
        load_body_sequence(tmp_path / "a.npz")
