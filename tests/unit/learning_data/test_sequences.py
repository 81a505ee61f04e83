"""Sequences that were collected, and which windows they have."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.learning_data.body_relative_points import body_relative_points
from drapeline.learning_data.sequences import SequenceData, collect_sequences
from toys.garment4d import GARMENT, save_toy_data, skirt_faces, toy_bodies, toy_sequences


@pytest.fixture(scope="module")
def collected(tmp_path_factory, toy_body):
    folder = tmp_path_factory.mktemp("sequences") / "data"
    return folder, save_toy_data(folder, toy_body)


@pytest.fixture
def data(collected):
    return SequenceData(collected[0])


def test_what_was_collected_comes_back_frame_by_frame(collected, data):
    _, sequences = collected
    assert data.garment_type == GARMENT
    assert data.name.tolist() == [one.name for one in sequences]
    for index, one in enumerate(sequences):
        rows = data.rows(index)
        np.testing.assert_array_equal(data.points[rows], one.points)
        np.testing.assert_array_equal(data.labels[rows], one.labels)
        np.testing.assert_array_equal(data.garment[rows], one.garment())
        np.testing.assert_allclose(data.poses[rows], one.poses, atol=1e-6)
        np.testing.assert_array_equal(data.number[rows], one.number)
        np.testing.assert_array_equal(data.canonical[index], one.canonical)
    assert data.points.filename is not None  # mapped, not read
    rebuilt = data.space.vertices(data.coefficients)
    train = data.of_split("train")
    # Width and length are all that varies, so that the space holds the training garments.
    np.testing.assert_allclose(rebuilt[train], data.canonical[train], atol=1e-3)


def test_coefficients_have_unit_variance_over_training_only(data):
    train = data.of_split("train")
    first = data.coefficients[train, :2]
    np.testing.assert_allclose(first.mean(axis=0), 0, atol=1e-4)
    np.testing.assert_allclose(first.std(axis=0), 1, atol=1e-3)


def test_a_sequence_shorter_than_a_window_is_named(data):
    with pytest.raises(InputError, match="sequence 00000 has 3 frames, expected at least 4"):
        data.windows("train", 4, 4)


def test_a_stride_that_leaves_out_frames_is_refused(data):
    with pytest.raises(InputError, match="of 3 frames have a stride of 4, expected at most 3"):
        data.windows("train", 3, 4)


def test_windows_keep_to_their_split_and_their_sources(data):
    for split in ("train", "val", "test"):
        windows = data.windows(split, 3, 3)
        assert set(data.split[windows[:, 0]]) == {split}
    simulated = data.windows("train", 3, 3, ("simulated",))
    assert set(data.source[simulated[:, 0]]) == {"blender"}
    assert len(data.windows("test", 3, 3, ("skinned",))) == 0


def test_places_on_the_body_are_those_for_the_body_as_read(data, toy_body):
    for sequence in (0, 5):
        rows = data.rows(sequence)
        expected = body_relative_points(
            toy_body, data.shape[sequence], data.poses[rows], data.points[rows]
        )
        np.testing.assert_array_equal(data.on_body[rows], expected[..., 3:])
    assert data.on_body.filename is not None  # mapped, not read
    assert data.on_inexact_body.filename is not None


def rest_places(data, sequence, *, inexact):
    """(F, P, 3) metres, where points are carried back to."""
    return (data.on_inexact_body if inexact else data.on_body)[data.rows(sequence)][..., :3]


def test_places_on_an_inexact_body_are_off_by_an_amount_of_each_sequence(data):
    off_m = [
        np.linalg.norm(
            rest_places(data, sequence, inexact=True) - rest_places(data, sequence, inexact=False),
            axis=-1,
        ).mean()
        for sequence in range(len(data))
    ]
    assert 0 < min(off_m) < 0.5 * max(off_m)
    assert np.median(off_m) < 0.15
    assert len(np.unique(off_m)) == len(off_m)
    assert np.isfinite(data.on_inexact_body).all()


def test_a_body_is_inexact_in_the_same_way_in_all_frames(data):
    """As one that was estimated: what is off hardly changes from frame to frame."""
    for sequence in data.of_split("train", ("simulated",)):
        off = rest_places(data, sequence, inexact=True) - rest_places(data, sequence, inexact=False)
        middle = np.median(off, axis=1)  # (F, 3), since single points change their place
        assert np.abs(middle - middle.mean(axis=0)).mean() < 0.5 * np.abs(middle).mean()


def test_inexact_bodies_depend_on_the_name_of_the_sequence_alone(data, toy_body, tmp_path):
    """Of several garment types the same sequence has the same places."""
    others = toy_sequences(toy_body)[::-1]
    collect_sequences(tmp_path / "data", GARMENT, others, skirt_faces(), 2, toy_bodies(toy_body))
    again = SequenceData(tmp_path / "data")
    names = again.name.tolist()
    for sequence, name in enumerate(data.name.tolist()):
        for inexact in (False, True):
            np.testing.assert_array_equal(
                rest_places(again, names.index(name), inexact=inexact),
                rest_places(data, sequence, inexact=inexact),
            )


def test_shares_of_labels_are_those_of_the_training_points(data):
    points = np.concatenate([data.labels[data.rows(s)].ravel() for s in data.of_split("train")])
    share = data.label_share("train")
    assert share.sum() == pytest.approx(1)
    for label, value in enumerate(share):
        assert value == pytest.approx((points == label).mean())


def test_garments_before_registration_are_kept_of_held_out_sequences_alone(collected, data):
    _, sequences = collected
    held_out = {one.name: one.original for one in sequences if one.split != "train"}
    assert data.originals.keys() == held_out.keys()
    for name, mesh in held_out.items():
        np.testing.assert_array_equal(data.originals[name].vertices, mesh.vertices)
        np.testing.assert_array_equal(data.originals[name].faces, mesh.faces)


def test_bad_sequences_are_named(tmp_path, toy_body):
    sequences, bodies = toy_sequences(toy_body)[:3], toy_bodies(toy_body)

    def collect(*changed):
        given = [*sequences, *changed]
        collect_sequences(tmp_path / "data", GARMENT, given, skirt_faces(), 3, bodies)

    with pytest.raises(InputError, match="two sequences are named 00001"):
        collect(sequences[1])
    with pytest.raises(InputError, match="00009 has points of 8 rows, expected 160"):
        collect(replace(sequences[1], name="00009", points=np.zeros((3, 8, 3))))
    holed = sequences[1].garment().copy()
    holed[2, 5, 0] = np.nan
    with pytest.raises(InputError, match="00009 holds NaN or infinity in frame 16"):
        collect(replace(sequences[1], name="00009", garment=lambda: holed))
    with pytest.raises(InputError, match="no sequences"):
        collect_sequences(tmp_path / "data", GARMENT, [], skirt_faces(), 3, bodies)
    assert not (tmp_path / "data").exists()


def test_damaged_folders_are_refused(collected, tmp_path):
    folder = tmp_path / "data"
    shutil.copytree(collected[0], folder)
    places = np.load(folder / "on_inexact_body.npy")
    np.save(folder / "on_inexact_body.npy", places[..., :3])
    with pytest.raises(InputError, match=r"on_inexact_body.npy: has shape \(45, 160, 3\)"):
        SequenceData(folder)
    (folder / "on_inexact_body.npy").unlink()
    with pytest.raises(InputError, match=r"on_inexact_body.npy: no such file"):
        SequenceData(folder)
    np.save(folder / "on_inexact_body.npy", places)
    np.save(folder / "labels.npy", np.zeros((3, 160), np.uint8))
    with pytest.raises(
        InputError, match=r"labels.npy: has shape \(3, 160\) .*expected \(45, 160\)"
    ):
        SequenceData(folder)
    (folder / "labels.npy").write_bytes(b"no array")
    with pytest.raises(InputError, match="labels.npy: does not start like an .npy array"):
        SequenceData(folder)
