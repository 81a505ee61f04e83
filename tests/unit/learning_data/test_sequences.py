"""Sequences that were collected, and which windows they have."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.learning_data.body_relative_points import body_relative_points
from drapeline.learning_data.sequences import (
    CloudData,
    SequenceData,
    collect_clouds,
    collect_sequences,
)
from drapeline.outfits.garment_types import LABELS
from toys.garment4d import (
    GARMENT,
    save_toy_data,
    save_toy_tops,
    skirt_faces,
    toy_bodies,
    toy_sequences,
    without_skirt,
)


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


@pytest.fixture
def clouds(tmp_path, data, toy_body):
    """Clouds of the same sequences, in the same order, as they are and worse."""
    collect_clouds(tmp_path / "clouds", toy_sequences(toy_body), toy_bodies(toy_body))
    return CloudData(tmp_path / "clouds")


def test_worse_clouds_are_points_of_the_frame_off_by_noise_with_their_labels(data, clouds):
    others = 0
    for sequence in range(len(data)):
        rows = data.rows(sequence)
        points, labels = clouds.worse_points[rows], clouds.worse_labels[rows]
        away = np.linalg.norm(points[:, :, None] - data.points[rows][:, None], axis=-1)
        same = labels[:, :, None] == data.labels[rows][:, None]
        # The noise is of two centimetres at most, which few points exceed four times.
        assert np.where(same, away, np.inf).min(axis=2).max() < 0.08
        assert away.min(axis=2).mean() > 1e-4
        others += not np.array_equal(labels, data.labels[rows])
    assert 0 < others < len(data)
    for key in ("worse_points", "worse_labels", "on_worse_body"):
        assert getattr(clouds, key).filename is not None  # mapped, not read


def worse_offsets(data, clouds, toy_body, sequence):
    """(F, 3) metres that worse bodies are off by, where points are carried back to."""
    rows = data.rows(sequence)
    exact = body_relative_points(
        toy_body, data.shape[sequence], data.poses[rows], clouds.worse_points[rows]
    )
    off = clouds.on_worse_body[rows][..., :3] - exact[..., 3:6]
    return np.median(off, axis=1)  # since single points change their place


def test_worse_clouds_lie_on_a_body_that_is_off_by_an_amount_of_each_sequence(
    data, clouds, toy_body
):
    off_m = [
        np.linalg.norm(worse_offsets(data, clouds, toy_body, sequence), axis=-1).mean()
        for sequence in range(len(data))
    ]
    assert 0 < min(off_m) < 0.5 * max(off_m)
    assert np.median(off_m) < 0.15
    assert len(np.unique(off_m)) == len(off_m)
    assert np.isfinite(clouds.on_worse_body).all()


def test_a_worse_body_is_off_in_the_same_way_in_all_frames(data, clouds, toy_body):
    """As one that was estimated: what is off hardly changes from frame to frame."""
    changes, sizes = [], []
    for sequence in data.of_split("train", ("simulated",)):
        off = worse_offsets(data, clouds, toy_body, sequence)
        changes.append(np.abs(off - off.mean(axis=0)).mean())
        sizes.append(np.abs(off).mean())
    assert sum(changes) < 0.5 * sum(sizes)


def test_what_is_worse_depends_on_the_name_of_the_sequence_alone(clouds, toy_body, tmp_path):
    others = toy_sequences(toy_body)[3::-1]
    collect_clouds(tmp_path / "again", others, toy_bodies(toy_body))
    again = CloudData(tmp_path / "again")
    for one in others:
        mine, theirs = again.rows_of(one.name), clouds.rows_of(one.name)
        for key in ("points", "labels", "on_body", "worse_points", "worse_labels", "on_worse_body"):
            np.testing.assert_array_equal(
                getattr(again, key)[mine], getattr(clouds, key)[theirs], key
            )
    with pytest.raises(InputError, match="again: has no sequence 00008, expected one"):
        again.rows_of("00008")


@pytest.fixture
def dressed_anyhow(tmp_path, toy_body):
    """Clouds of toy skirts, and of somebody who wears a top and trousers alone."""
    return save_toy_tops(tmp_path / "labelled", toy_body), CloudData(tmp_path / "labelled")


def test_clouds_are_of_all_sequences_whatever_is_worn_in_them(dressed_anyhow):
    sequences, clouds = dressed_anyhow
    assert len(clouds) == len(sequences) == 10
    for index, one in enumerate(sequences):
        rows = clouds.rows(index)
        np.testing.assert_array_equal(clouds.points[rows], one.points)
        np.testing.assert_array_equal(clouds.labels[rows], one.labels)
        for key in ("name", "source", "split", "clip"):
            assert getattr(clouds, key)[index] == getattr(one, key)
    worn = clouds.labels[clouds.rows(9)]
    assert {LABELS[label] for label in np.unique(worn)} == {"Body", "Top", "Trousers"}
    assert np.isin(clouds.worse_labels[clouds.rows(9)], worn).all()
    assert clouds.points.filename is not None  # mapped, not read
    assert {"points", "on_worse_body", "name"} <= clouds.arrays().keys()


def test_clouds_have_the_windows_and_splits_of_their_sequences(dressed_anyhow, data):
    _, clouds = dressed_anyhow
    for split in ("val", "test"):
        np.testing.assert_array_equal(clouds.windows(split, 3, 2), data.windows(split, 3, 2))
    more = [[9, 0], [9, 2]]
    np.testing.assert_array_equal(
        clouds.windows("train", 3, 2), [*data.windows("train", 3, 2).tolist(), *more]
    )


def test_the_number_of_frames_is_told(tmp_path, toy_body):
    sequences, bodies = toy_sequences(toy_body)[:2], toy_bodies(toy_body)
    assert collect_clouds(tmp_path / "a", sequences, bodies) == 6
    assert collect_sequences(tmp_path / "b", GARMENT, sequences, skirt_faces(), 2, bodies) == 6


def test_clouds_without_sequences_or_with_one_twice_are_refused(tmp_path, toy_body):
    one = toy_sequences(toy_body)[0]
    seen = without_skirt(one, one.name)
    bodies = toy_bodies(toy_body)
    with pytest.raises(InputError, match="no sequences, expected one or more"):
        collect_clouds(tmp_path / "a", [], bodies)
    with pytest.raises(InputError, match="two sequences are named 00000, expected one"):
        collect_clouds(tmp_path / "a", [seen, one], bodies)
    with pytest.raises(InputError, match="00009 has points of 8 rows, expected 160"):
        small = replace(seen, name="00009", points=np.zeros((3, 8, 3)))
        collect_clouds(tmp_path / "a", [seen, small], bodies)
    holed = seen.points.copy()
    holed[1, 7, 2] = np.inf
    with pytest.raises(InputError, match="00009 holds NaN or infinity in frame 13"):
        collect_clouds(tmp_path / "a", [seen, replace(seen, name="00009", points=holed)], bodies)
    assert not (tmp_path / "a").exists()


def test_shares_of_labels_are_those_of_the_training_points(data):
    points = np.concatenate([data.labels[data.rows(s)].ravel() for s in data.of_split("train")])
    share = data.label_share("train")
    assert share.sum() == pytest.approx(1)
    for label, value in enumerate(share):
        assert value == pytest.approx((points == label).mean())


def test_shares_of_labels_may_be_those_of_one_kind_of_sequences(dressed_anyhow, data):
    _, clouds = dressed_anyhow
    top = LABELS.index("Top")
    assert clouds.label_share("train", ("simulated",))[top] > 0
    assert clouds.label_share("train", ("skinned",))[top] == 0
    for kinds in (("simulated",), ("skinned",)):
        found = [data.labels[data.rows(s)].ravel() for s in data.of_split("train", kinds)]
        expected = np.bincount(np.concatenate(found), minlength=len(LABELS))
        np.testing.assert_allclose(data.label_share("train", kinds), expected / expected.sum())
    assert not data.label_share("test", ("skinned",)).any()


def test_a_label_that_there_is_not_is_refused(data):
    data.labels = np.array(data.labels)
    data.labels[data.rows(4)][0, 0] = len(LABELS)
    with pytest.raises(InputError, match=rf"labels.npy: holds label {len(LABELS)}, expected 0 to"):
        data.label_share("train")
    assert data.label_share("val").sum() == pytest.approx(1)


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
    places = np.load(folder / "on_body.npy")
    np.save(folder / "on_body.npy", places[..., :3])
    with pytest.raises(InputError, match=r"on_body.npy: has shape \(45, 160, 3\)"):
        SequenceData(folder)
    (folder / "on_body.npy").unlink()
    with pytest.raises(InputError, match=r"on_body.npy: no such file"):
        SequenceData(folder)
    np.save(folder / "on_body.npy", places)
    np.save(folder / "labels.npy", np.zeros((3, 160), np.uint8))
    with pytest.raises(
        InputError, match=r"labels.npy: has shape \(3, 160\) .*expected \(45, 160\)"
    ):
        SequenceData(folder)
    (folder / "labels.npy").write_bytes(b"no array")
    with pytest.raises(InputError, match="labels.npy: does not start like an .npy array"):
        SequenceData(folder)


def test_damaged_folders_of_clouds_are_refused(dressed_anyhow, tmp_path):
    folder = tmp_path / "labelled"
    np.save(folder / "worse_labels.npy", np.zeros((3, 160), np.uint8))
    with pytest.raises(InputError, match=r"worse_labels.npy: has shape \(3, 160\)"):
        CloudData(folder)
    (folder / "worse_labels.npy").unlink()
    with pytest.raises(InputError, match=r"worse_labels.npy: no such file"):
        CloudData(folder)
    with pytest.raises(InputError, match=r"about.json: no such file"):
        SequenceData(folder)
