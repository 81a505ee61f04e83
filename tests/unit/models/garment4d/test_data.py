"""Collected sequences and their windows."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from drapeline.bodies.kinematics import rest_to_pose
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.models.garment4d.body_input import BodySet, PosedBody, SkinningSettings
from drapeline.models.garment4d.data import (
    SequenceData,
    Windows,
    collect_garment4d,
    window_starts,
)
from drapeline.models.training.batches import GarmentData
from drapeline.registration.to_body.dynamic_offsets import moved
from garment4d_toys import KIND, save_toy_data, skirt_faces, toy_bodies, toy_sequences

SKINNING = SkinningSettings(neighbours=16, passes=5)


@pytest.fixture(scope="module")
def collected(tmp_path_factory, toy_body):
    folder = tmp_path_factory.mktemp("garment4d") / "data"
    return folder, save_toy_data(folder, toy_body)


@pytest.fixture
def data(collected, toy_body):
    data = SequenceData(collected[0], BodySet(toy_bodies(toy_body), 40))
    data.wear(data.canonical, SKINNING)
    return data


def test_what_was_collected_comes_back_frame_by_frame(collected, data):
    _, sequences = collected
    assert data.kind == KIND
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


@pytest.mark.parametrize(
    ("count", "frames", "stride", "starts"),
    [
        (8, 4, 4, [0, 4]),
        (7, 4, 4, [0, 3]),
        (9, 4, 4, [0, 4, 5]),
        (4, 4, 2, [0]),
        (6, 3, 1, [0, 1, 2, 3]),
    ],
)
def test_windows_cover_every_frame_without_padding(count, frames, stride, starts):
    assert window_starts(count, frames, stride, "s") == starts
    covered = {start + k for start in starts for k in range(frames)}
    assert covered == set(range(count))


def test_a_sequence_shorter_than_a_window_is_named(data):
    with pytest.raises(InputError, match="sequence 00000 has 3 frames, expected at least 4"):
        data.windows("train", 4, 4)


def test_a_stride_that_leaves_out_frames_is_refused(data):
    with pytest.raises(InputError, match="of 3 frames have a stride of 4, expected at most 3"):
        data.windows("train", 3, 4)


def test_only_simulated_sequences_have_every_frame(data):
    found = [data.consecutive(sequence) for sequence in range(len(data))]
    assert found == (data.source == "simulated").tolist()


def test_windows_keep_to_their_split_and_their_sources(data):
    for split in ("train", "val", "test"):
        windows = data.windows(split, 3, 3)
        assert set(data.split[windows[:, 0]]) == {split}
    simulated = data.windows("train", 3, 3, ("simulated",))
    assert set(data.source[simulated[:, 0]]) == {"simulated"}
    assert len(data.windows("test", 3, 3, ("skinned",))) == 0


def test_a_batch_holds_the_window_s_frames(collected, data):
    _, sequences = collected
    batch = data.batch(np.array([[4, 2], [7, 1]]), 3, posed=True)
    for row, (index, start) in enumerate(((4, 2), (7, 1))):
        one, span = sequences[index], slice(start, start + 3)
        np.testing.assert_array_equal(batch["points"][row], one.points[span])
        np.testing.assert_array_equal(batch["labels"][row], one.labels[span])
        np.testing.assert_array_equal(batch["target"][row], one.garment()[span])
        np.testing.assert_allclose(batch["poses"][row], one.poses[span], atol=1e-6)
    assert batch["names"] == ["00004/12", "00007/11"]
    assert batch["labels"].dtype == np.int64
    assert {value.dtype for key, value in batch.items() if key in ("body", "proposal")} == {
        np.dtype(np.float32)
    }


def test_proposals_are_the_skinned_garments_that_are_worn(collected, data):
    _, sequences = collected
    batch = data.batch(np.array([[4, 1]]), 3, posed=True)
    wearer = data.wearer(4)
    motions = rest_to_pose(wearer.model, wearer.shape, data.poses[data.rows(4)][1:4])
    expected = moved(sequences[4].canonical, motions, data.weights(4))
    np.testing.assert_allclose(batch["proposal"][0], expected, atol=1e-5)
    # At rest nothing moves.
    rest = wearer.transforms(REST_POSE[None])
    np.testing.assert_allclose(rest[0], np.broadcast_to(np.eye(4), (24, 4, 4)), atol=1e-6)
    # Toy garments sway off their skinning, by up to 2 cm and never more.
    away = np.linalg.norm(batch["proposal"] - batch["target"], axis=-1)
    assert 0.002 < away.max() < 0.025


@pytest.mark.parametrize("rooms", [0, 1.5, 100])
def test_what_does_not_fit_into_memory_is_computed_of_the_frames_asked_for(
    data, rooms, monkeypatch
):
    rows = [data.rows(sequence) for sequence in (4, 5)]
    whole = [data.wearer(s).shown(data.poses[r]) for s, r in zip((4, 5), rows, strict=True)]
    frames = len(whole[0][0])
    size = sum(x.nbytes for x in whole[0]) + frames * 24 * 16 * 4  # transforms too
    monkeypatch.setattr("drapeline.models.garment4d.data._KEPT_BYTES", int(rooms * size))
    data.wear(data.canonical, SKINNING)
    wearers = {sequence: data.wearer(sequence) for sequence in (4, 5)}
    assert all(len(wearer.rest) == 2 for wearer in wearers.values())  # made beforehand
    asked = []
    shown = PosedBody.shown

    def counted(wearer, poses):
        asked.append(len(poses))
        return shown(wearer, poses)

    monkeypatch.setattr(PosedBody, "shown", counted)
    for sequence, expected in ((4, whole[0]), (5, whole[1]), (4, whole[0]), (5, whole[1])):
        found = data.batch(np.array([[sequence, 2]]), 3, posed=True)
        for key, values in zip(("body", "body_normals"), expected, strict=True):
            np.testing.assert_allclose(found[key][0], values[2:5], atol=1e-6)
    once = 3
    assert (
        asked
        == {
            0: [once] * 4,
            1.5: [once, frames, once, once],
            100: [once, frames, once, frames],
        }[rooms]
    )


def test_points_are_located_once_with_the_body_that_is_read_again(data, toy_body, tmp_path):
    for sequence in (0, 5):
        rows = data.rows(sequence)
        expected = data.wearer(sequence).body_relative_points(data.points[rows], data.poses[rows])
        np.testing.assert_array_equal(data.clouds(sequence, body_relative_points=True), expected)
        part = data.clouds(sequence, body_relative_points=True, frames=slice(1, 3))
        np.testing.assert_array_equal(part, expected[1:3])
    sequences = toy_sequences(toy_body)
    collect_garment4d(tmp_path / "data", KIND, sequences, skirt_faces(), 3)
    plain = SequenceData(tmp_path / "data", BodySet(toy_bodies(toy_body), 10))
    assert plain.clouds(0, body_relative_points=False).shape[-1] == 3
    with pytest.raises(InputError, match=r"body_relative_points\.npy"):
        plain.clouds(0, body_relative_points=True)


def test_shares_of_labels_are_those_of_the_training_points(data):
    points = np.concatenate([data.labels[data.rows(s)].ravel() for s in data.of_split("train")])
    share = data.label_share("train")
    assert share.sum() == pytest.approx(1)
    for label, found in enumerate(share):
        assert found == pytest.approx((points == label).mean())


def test_predicted_canonicals_change_proposals_but_not_the_truth(data):
    window = np.array([[4, 1]])
    before = data.batch(window, 3, posed=True)
    data.wear(data.canonical + np.float32([0, 0, -0.1]), SKINNING)
    after = data.batch(window, 3, posed=True)
    assert np.linalg.norm(after["proposal"] - before["proposal"], axis=-1).mean() > 0.05
    np.testing.assert_array_equal(after["canonical"], before["canonical"])
    np.testing.assert_array_equal(after["target"], before["target"])


def test_training_sees_train_and_val_windows_only(data):
    loader = GarmentData(Windows(data, frames=3, stride=2, posed=False), batch=4, seed=0)
    seen = {"train": set(), "val": set()}
    for split, batches in ((split, loader.loader(split)) for split in ("train", "val")):
        for batch in batches:
            assert batch["points"].shape[1:] == (3, 160, 3)
            assert "proposal" not in batch
            seen[split] |= set(batch["sequence"].tolist())
    assert seen["train"] == set(data.of_split("train").tolist())
    assert seen["val"] == set(data.of_split("val").tolist())


@pytest.mark.parametrize(("posed", "most"), [(False, 3), (True, 4)])
def test_long_sequences_do_not_decide_alone_on_canonical_garments(data, posed, most):
    windows = Windows(data, frames=2, stride=2, posed=posed)
    rows = windows.batch(windows.rows("val"))
    count = np.bincount(rows["sequence"])
    longest = int(data.count[data.of_split("val")].max())
    assert longest == 7  # four windows of two frames
    assert count.max() == most
    of_longest = np.sort(rows["start"][rows["sequence"] == count.argmax()])
    assert (of_longest[0], of_longest[-1]) == (0, longest - 2)


def test_validation_falls_back_on_other_sources(tmp_path, toy_body, caplog):
    sequences = [one for one in toy_sequences(toy_body) if one.name != "00007"]
    collect_garment4d(tmp_path / "data", KIND, sequences, skirt_faces(), 3)
    data = SequenceData(tmp_path / "data", BodySet(toy_bodies(toy_body), 10))
    windows = Windows(data, frames=3, stride=3, sources=("simulated",), posed=False)
    batch = windows.batch(windows.rows("val"))
    assert [str(data.source[s]) for s in batch["sequence"]] == ["skinned"]
    assert "no simulated Skirt in the validation split" in caplog.text
    trained = windows.batch(windows.rows("train"))["sequence"]
    assert set(data.source[trained]) == {"simulated"}


def test_bad_sequences_are_named(tmp_path, toy_body):
    sequences = toy_sequences(toy_body)[:3]

    def collect(*changed):
        collect_garment4d(tmp_path / "data", KIND, [*sequences, *changed], skirt_faces(), 3)

    with pytest.raises(InputError, match="two sequences are named 00001"):
        collect(sequences[1])
    with pytest.raises(InputError, match="00009 has points of 8 rows, expected 160"):
        collect(replace(sequences[1], name="00009", points=np.zeros((3, 8, 3))))
    holed = sequences[1].garment().copy()
    holed[2, 5, 0] = np.nan
    with pytest.raises(InputError, match="00009 holds NaN or infinity in frame 16"):
        collect(replace(sequences[1], name="00009", garment=lambda: holed))
    with pytest.raises(InputError, match="no sequences"):
        collect_garment4d(tmp_path / "data", KIND, [], skirt_faces(), 3)
    assert not (tmp_path / "data").exists()


def test_damaged_folders_are_refused(collected, tmp_path, toy_body):
    folder = tmp_path / "data"
    shutil.copytree(collected[0], folder)
    np.save(folder / "labels.npy", np.zeros((3, 160), np.uint8))
    wearers = BodySet(toy_bodies(toy_body), 10)
    with pytest.raises(InputError, match=r"arrays of 3, \d+ frames, expected \d+ as in"):
        SequenceData(folder, wearers)
    (folder / "labels.npy").write_bytes(b"no array")
    with pytest.raises(InputError, match="not readable as an array"):
        SequenceData(folder, wearers)
