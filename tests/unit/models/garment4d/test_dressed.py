"""Bodies in motion in the garments that they are dressed in."""

import numpy as np
import pytest

from drapeline.bodies.rest_body import rest_body, rest_to_pose
from drapeline.bodies.skinning import skin_points
from drapeline.frames import REST_POSE
from drapeline.models.garment4d.data import (
    DressedSequences,
    ShapedBody,
    propose_garment,
    skinning_weights,
)
from drapeline.models.garment4d.settings import SkinningSettings
from toys.garment4d import skirt_faces

SKINNING = SkinningSettings(neighbours=16, passes=5)


@pytest.fixture
def dressed(sequences):
    return DressedSequences(sequences, sequences.data.canonical, SKINNING)


def test_a_batch_holds_the_true_garment_and_the_body_of_every_frame(toy_skirts, dressed):
    batch = dressed.batch(np.array([[4, 2], [7, 1]]), 3)
    for row, (index, start) in enumerate(((4, 2), (7, 1))):
        one, span = toy_skirts[index], slice(start, start + 3)
        np.testing.assert_array_equal(batch["points"][row], one.points[span])
        np.testing.assert_array_equal(batch["target"][row], one.garment()[span])
        np.testing.assert_allclose(batch["poses"][row], one.poses[span], atol=1e-6)
        vertices, normals = dressed.body(index).pose_surface(batch["poses"][row])
        np.testing.assert_allclose(batch["body"][row], vertices, atol=1e-5)
        np.testing.assert_allclose(batch["body_normals"][row], normals, atol=1e-4)
    assert {batch[key].dtype for key in ("body", "proposal")} == {np.dtype(np.float32)}


def test_proposals_are_the_skinned_garments_that_are_worn(toy_skirts, dressed):
    data, body = dressed.data, dressed.body(4)
    batch = dressed.batch(np.array([[4, 1]]), 3)
    motions = rest_to_pose(body.model, body.shape, data.poses[data.rows(4)][1:4])
    expected = skin_points(toy_skirts[4].canonical, motions, dressed.weights(4))
    np.testing.assert_allclose(batch["proposal"][0], expected, atol=1e-5)
    # At rest nothing moves.
    rest = body.transforms(REST_POSE[None])
    np.testing.assert_allclose(rest[0], np.broadcast_to(np.eye(4), (24, 4, 4)), atol=1e-6)
    # Toy garments sway off their skinning, by up to 2 cm and never more.
    away = np.linalg.norm(batch["proposal"] - batch["target"], axis=-1)
    assert 0.002 < away.max() < 0.025


def test_other_garments_change_proposals_but_not_the_truth(sequences, dressed):
    window = np.array([[4, 1]])
    lower = sequences.data.canonical + np.float32([0, 0, -0.1])
    before = dressed.batch(window, 3)
    other = DressedSequences(dressed, lower, SKINNING).batch(window, 3)
    assert np.linalg.norm(other["proposal"] - before["proposal"], axis=-1).mean() > 0.05
    np.testing.assert_array_equal(other["worn"][0], lower[4])
    for key in ("canonical", "target"):
        np.testing.assert_array_equal(other[key], before[key])
    again = dressed.batch(window, 3)
    for key in ("worn", "proposal"):
        np.testing.assert_array_equal(again[key], before[key])


def test_a_garment_is_proposed_as_in_batches(dressed):
    data = dressed.data
    poses = data.poses[data.rows(4)][1:4]
    made = propose_garment(dressed.body(4), poses, data.canonical[4], data.space.faces, SKINNING)
    batch = dressed.batch(np.array([[4, 1]]), 3)
    np.testing.assert_allclose(made, batch["proposal"][0], atol=1e-6)


@pytest.mark.parametrize("rooms", [0, 1.5, 100])
def test_motions_that_are_not_kept_are_computed_for_the_frames_asked_for(
    sequences, rooms, monkeypatch
):
    data = sequences.data
    rows = [data.rows(sequence) for sequence in (4, 5)]
    bodies = [sequences.body(sequence) for sequence in (4, 5)]
    whole = [body.pose_surface(data.poses[r]) for body, r in zip(bodies, rows, strict=True)]
    frames = len(whole[0][0])
    size = sum(x.nbytes for x in whole[0]) + frames * 24 * 16 * 4  # transforms too
    monkeypatch.setattr("drapeline.models.garment4d.data._KEPT_BYTES", int(rooms * size))
    dressed = DressedSequences(sequences, data.canonical, SKINNING)
    assert all(len(dressed.body(sequence).rest_surface) == 2 for sequence in (4, 5))
    asked = []
    pose_surface = ShapedBody.pose_surface

    def counted(body, poses):
        asked.append(len(poses))
        return pose_surface(body, poses)

    monkeypatch.setattr(ShapedBody, "pose_surface", counted)
    for sequence, expected in ((4, whole[0]), (5, whole[1]), (4, whole[0]), (5, whole[1])):
        batch = dressed.batch(np.array([[sequence, 2]]), 3)
        for key, values in zip(("body", "body_normals"), expected, strict=True):
            np.testing.assert_allclose(batch[key][0], values[2:5], atol=1e-6)
    once = 3
    assert (
        asked
        == {
            0: [once] * 4,
            1.5: [once, frames, once, once],
            100: [once, frames, once, frames],
        }[rooms]
    )


def test_weights_are_interpolated_once(dressed, monkeypatch):
    first = dressed.weights(4)
    canonical, faces = dressed.data.canonical[4], dressed.data.space.faces
    expected = skinning_weights(dressed.body(4), canonical, faces, SKINNING)
    np.testing.assert_array_equal(first, expected)
    monkeypatch.setattr("drapeline.models.garment4d.data.skinning_weights", None)
    assert dressed.weights(np.int64(4)) is first


def test_weights_copied_from_one_neighbour_are_those_of_the_skin_beneath(sequences, toy_body):
    body, canonical = sequences.body(4), sequences.data.canonical[4]
    copied = SkinningSettings(neighbours=1, passes=0)
    weights = skinning_weights(body, canonical, skirt_faces(), copied)
    assert weights.shape == (60, 24)
    rest = rest_body(toy_body, body.shape)
    away = np.linalg.norm(canonical[:, None] - rest, axis=-1)
    for row, distance in zip(weights, away, strict=True):  # several may be as near
        nearest = toy_body.weights[distance < distance.min() + 1e-6]
        assert np.abs(nearest - row).max(axis=1).min() < 1e-6
