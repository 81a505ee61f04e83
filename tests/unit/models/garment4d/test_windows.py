"""Windows that the canonical stage is trained on."""

import numpy as np
import pytest

from drapeline.learning_data.sequences import collect_sequences
from drapeline.models.garment4d.data import Windows
from drapeline.models.training.batches import TrainingBatches
from toys.garment4d import GARMENT, open_toy_data, skirt_faces, toy_sequences


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


def test_a_batch_holds_body_relative_points_if_asked_for(sequences):
    window = np.array([[4, 2]])
    plain, relative = (
        sequences.batch(window, 3, body_relative_points=wanted)["points"]
        for wanted in (False, True)
    )
    np.testing.assert_array_equal(relative[..., :3], plain)
    expected = sequences.data.clouds(4, body_relative_points=True)[2:5]
    np.testing.assert_array_equal(relative[0], expected)


def test_the_digested_arrays_tell_data_and_bodies_apart(sequences, folder, toy_body):
    arrays = sequences.arrays()
    assert {"points", "poses", "space/mean", "bodies/female/chosen"} <= arrays.keys()
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
    collect_sequences(tmp_path / "data", GARMENT, skirts, skirt_faces(), 3)
    sequences = open_toy_data(tmp_path / "data", toy_body, 10)
    windows = Windows(sequences, frames=3, stride=3, sources=("simulated",))
    batch = windows.batch(windows.rows("val"))
    assert [str(sequences.data.source[s]) for s in batch["sequence"]] == ["skinned"]
    assert "no simulated Skirt in the validation split" in caplog.text
    trained = windows.batch(windows.rows("train"))["sequence"]
    assert set(sequences.data.source[trained]) == {"blender"}
