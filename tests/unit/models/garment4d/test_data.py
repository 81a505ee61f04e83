"""Inputs of the networks."""

from dataclasses import replace

import numpy as np
import pytest

from drapeline.bodies.kinematics import skin_points
from drapeline.bodies.model import posed_vertices
from drapeline.bodies.rest_body import rest_body, rest_to_pose
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import vertex_normals
from drapeline.learning_data.sequences import collect_sequences
from drapeline.models.garment4d.data import (
    BodySet,
    DressedSequences,
    SequenceWindows,
    ShapedBody,
    SurfaceSample,
    Windows,
    propose_garment,
    skinning_weights,
)
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.models.training.batches import TrainingBatches
from drapeline.seeding import rng_for
from toys.garment4d import GARMENT, open_toy_data, skirt_faces, toy_bodies, toy_sequences
from toys.gcvae import tube_faces

SKINNING = SkinningSettings(neighbours=16, passes=5)
FACES = tube_faces(False)


def test_body_points_and_normals_are_those_of_the_whole_body(toy_body):
    rng = rng_for(0, "surface")
    chosen = rng.permutation(len(toy_body.v_template))[:30]
    shape, poses = rng.uniform(-2, 2, 10), REST_POSE + rng.normal(0, 0.3, (4, 72))
    whole, _ = posed_vertices(toy_body, shape, poses)
    vertices, normals = SurfaceSample(toy_body, chosen).pose(shape, poses)
    np.testing.assert_allclose(vertices, whole[:, chosen], atol=1e-6)
    for frame in range(4):
        expected = vertex_normals(whole[frame], toy_body.faces)[chosen]
        np.testing.assert_allclose(normals[frame], expected, atol=1e-4)


def test_pose_blend_shapes_reach_the_body_points(toy_body):
    rng = rng_for(0, "blend shapes")
    body = replace(
        toy_body, posedirs=rng.normal(0, 0.01, toy_body.posedirs.shape).astype(np.float32)
    )
    shape, poses = np.zeros(10), REST_POSE + rng.normal(0, 0.3, (2, 72))
    whole, _ = posed_vertices(body, shape, poses)
    vertices, _ = SurfaceSample(body, np.arange(25)).pose(shape, poses)
    np.testing.assert_allclose(vertices, whole[:, :25], atol=1e-5)
    assert np.abs(whole - posed_vertices(toy_body, shape, poses)[0]).max() > 0.005


def test_bodies_of_both_genders_show_the_same_vertices(toy_body):
    bodies = BodySet(toy_bodies(toy_body), 30)
    arrays = bodies.arrays()
    np.testing.assert_array_equal(arrays["female/chosen"], arrays["male/chosen"])
    assert len(np.unique(arrays["female/chosen"])) == 30
    body = bodies.of("male", np.full(10, 0.3))
    assert body.model is bodies.models["male"]
    whole, _ = posed_vertices(toy_body, body.shape, REST_POSE[None])
    vertices, normals = body.rest_surface
    np.testing.assert_allclose(vertices, whole[0, arrays["male/chosen"]], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)


def test_a_batch_holds_the_window_s_frames(toy_skirts, sequences):
    batch = sequences.batch(np.array([[4, 2], [7, 1]]), 3)
    for row, (index, start) in enumerate(((4, 2), (7, 1))):
        one, span = toy_skirts[index], slice(start, start + 3)
        np.testing.assert_array_equal(batch["points"][row], one.points[span])
        np.testing.assert_array_equal(batch["labels"][row], one.labels[span])
        np.testing.assert_array_equal(batch["canonical"][row], one.canonical)
        vertices, normals = sequences.body(index).rest_surface
        np.testing.assert_array_equal(batch["rest_body"][row], vertices)
        np.testing.assert_array_equal(batch["rest_normals"][row], normals)
    assert batch["names"] == ["00004/12", "00007/11"]
    assert (batch["sequence"].tolist(), batch["start"].tolist()) == ([4, 7], [2, 1])
    assert batch["labels"].dtype == np.int64


def test_a_sequence_is_seen_as_a_whole(toy_skirts, sequences):
    data, one = sequences.data, toy_skirts[4]
    seen = sequences.seen(4)
    np.testing.assert_array_equal(seen.points, one.points)
    np.testing.assert_allclose(seen.poses, one.poses, atol=1e-6)
    np.testing.assert_array_equal(seen.trans, data.trans[data.rows(4)])
    assert seen.body is sequences.body(4)
    assert seen.labels is None
    told = sequences.seen(4, one.labels)
    np.testing.assert_array_equal(told.taken_for(data.label), one.labels == data.label)


def test_unknown_labels_cannot_be_asked_for(held_out):
    with pytest.raises(ValueError, match="the points have no labels, expected some"):
        held_out.taken_for(0)


@pytest.mark.parametrize("labelled", [False, True])
def test_frames_of_a_sequence_stay_together(sequences, data, labelled):
    sequence = int(data.of_split("test")[0])
    labels = data.labels[data.rows(sequence)] if labelled else None
    seen = sequences.seen(sequence, labels)
    part = seen.frames(np.array([1, 3]))
    for key in ("points", "poses", "trans", *["labels"] * labelled):
        np.testing.assert_array_equal(getattr(part, key), getattr(seen, key)[[1, 3]])
    assert (part.labels is None) == (not labelled)
    assert part.body is seen.body


@pytest.mark.parametrize(
    ("count", "stride", "starts"),
    [
        (7, None, [0, 3, 4]),
        (7, 1, [0, 1, 2, 3, 4]),
        (3, None, [0]),
        (31, None, [*range(0, 28, 3), 28]),
    ],
)
def test_windows_cover_a_sequence_a_few_at_a_time(count, stride, starts):
    windows, values = SequenceWindows(count, 3, stride), 10 * np.arange(2 * count).reshape(count, 2)
    batches = list(windows.batches())
    assert np.concatenate(batches).tolist() == starts
    assert max(map(len, batches)) <= 4
    mean = windows.mean((2,))
    for batch in batches:
        found = windows.of(batch, values)
        for start, window in zip(batch, found, strict=True):
            np.testing.assert_array_equal(window, values[start : start + 3])
        mean.add(batch, found)
    np.testing.assert_allclose(mean(), values)


def test_a_frame_in_several_windows_gets_the_mean_of_them():
    windows = SequenceWindows(4, 3, 1)
    mean = windows.mean(())
    mean.add(windows.starts, np.array([[1.0, 2.0, 3.0], [10.0, 20.0, 30.0]]))
    np.testing.assert_allclose(mean(), [1, (2 + 10) / 2, (3 + 20) / 2, 30])


def test_the_digested_arrays_tell_data_and_bodies_apart(sequences, folder, toy_body):
    arrays = sequences.arrays()
    known = {"points", "on_body", "poses", "space/mean", "bodies/female/chosen"}
    assert known <= arrays.keys()
    fewer = open_toy_data(folder / "data", toy_body, 29).arrays()
    assert fewer.keys() == arrays.keys()
    changed = [key for key in arrays if not np.array_equal(arrays[key], fewer[key])]
    assert changed == ["bodies/female/chosen", "bodies/male/chosen"]


def test_training_sees_train_and_val_windows_only(sequences):
    loader = TrainingBatches(Windows(sequences, frames=3, stride=2), batch=4, seed=0)
    seen = {"train": set(), "val": set()}
    for split, batches in ((split, loader.loader(split)) for split in ("train", "val")):
        for batch in batches:
            assert batch["points"].shape[1:] == (3, 160, 3)
            assert "proposal" not in batch
            seen[split] |= set(batch["sequence"].tolist())
    for split, found in seen.items():
        assert found == set(sequences.data.of_split(split).tolist())


@pytest.mark.parametrize(("most_validated", "most"), [(3, 3), (None, 4)])
def test_long_sequences_do_not_decide_alone_on_canonical_garments(sequences, most_validated, most):
    windows = Windows(sequences, frames=2, stride=2, most_validated=most_validated)
    rows = windows.batch(windows.rows("val"))
    count = np.bincount(rows["sequence"])
    longest = int(sequences.data.count[sequences.data.of_split("val")].max())
    assert longest == 7  # four windows of two frames
    assert count.max() == most
    of_longest = np.sort(rows["start"][rows["sequence"] == count.argmax()])
    assert (of_longest[0], of_longest[-1]) == (0, longest - 2)


def test_validation_falls_back_on_other_sources(tmp_path, toy_body, caplog):
    skirts = [one for one in toy_sequences(toy_body) if one.name != "00007"]
    bodies = toy_bodies(toy_body)
    collect_sequences(tmp_path / "data", GARMENT, skirts, skirt_faces(), 3, bodies)
    sequences = open_toy_data(tmp_path / "data", toy_body, 10)
    windows = Windows(sequences, frames=3, stride=3, sources=("simulated",))
    batch = windows.batch(windows.rows("val"))
    assert [str(sequences.data.source[s]) for s in batch["sequence"]] == ["skinned"]
    assert "no simulated Skirt in the validation split" in caplog.text
    trained = windows.batch(windows.rows("train"))["sequence"]
    assert set(sequences.data.source[trained]) == {"blender"}


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
