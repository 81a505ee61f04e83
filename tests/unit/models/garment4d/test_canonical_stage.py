"""The canonical stage in training."""

import numpy as np
import pytest
import torch

from drapeline.models.garment4d.losses import balance_labels
from drapeline.models.garment4d.stages import CanonicalStage, PointNetStage, load_stage
from drapeline.models.training.batches import as_tensors
from toys.garment4d import CANONICAL, PLAIN
from toys.garment4d_stages import batch_of, build_canonical, stage_windows, train_toys
from toys.histories import column


def test_the_error_that_is_logged_is_that_of_canonical_garments(trained_canonical, sequences):
    data, stage = sequences.data, load_stage(trained_canonical, CanonicalStage)
    batch = batch_of(stage, sequences, "val")
    with torch.no_grad():
        made = stage.network(batch["points"]).vertices.numpy()
    true = data.canonical[batch["sequence"]]
    expected = 1000 * np.linalg.norm(made - true, axis=-1).mean()
    best = np.argmin(column(trained_canonical, "val_total"))
    assert column(trained_canonical, "val_canonical_error_mm")[best] == pytest.approx(
        expected, rel=1e-3
    )


def test_searches_of_earlier_epochs_change_nothing(
    tmp_path, trained_canonical, sequences, monkeypatch
):
    monkeypatch.setattr("drapeline.models.garment4d.stages._KEPT_BYTES", 0)
    searched = train_toys(tmp_path, "searched", build_canonical(sequences, PLAIN), sequences)
    for name in ("train_total", "val_total"):
        np.testing.assert_allclose(
            column(searched, name), column(trained_canonical, name), rtol=1e-5
        )


@pytest.mark.parametrize("cls", [CanonicalStage, PointNetStage])
def test_searches_of_earlier_epochs_are_not_repeated(sequences, cls, monkeypatch):
    stage = build_canonical(sequences, CANONICAL, cls)
    batch = batch_of(stage, sequences, "train")
    with torch.no_grad():
        first = stage.estimate(batch)
        monkeypatch.setattr("drapeline.models.layers.point_search._launch", None)
        again = stage.estimate(batch)
        with pytest.raises(TypeError):  # validation does not remember
            stage.eval().estimate(batch)
    for key in ("coefficients", "vertices"):
        assert torch.equal(getattr(again, key), getattr(first, key))


def test_weights_of_labels_come_from_the_data_and_are_loaded_again(tmp_path, sequences):
    data = sequences.data
    data.labels = np.where(np.arange(data.labels.shape[1]) % 3, data.labels, 0)
    values = {**CANONICAL, "training": {**CANONICAL["training"], "epochs": 1}}
    out = train_toys(tmp_path, "uneven", build_canonical(sequences, values), sequences)
    uneven = load_stage(out, CanonicalStage)
    expected = balance_labels(data.label_share("train"), 0.5)
    assert len(expected[expected > 0].unique()) > 1
    torch.testing.assert_close(uneven.label_weights, expected)


def test_maps_of_the_body_are_fitted_to_training_sequences_and_loaded_again(
    trained_body_relative, sequences
):
    data, stage = sequences.data, load_stage(trained_body_relative, CanonicalStage)
    trained = data.name[data.of_split("train")].tolist()
    assert sorted(stage.out_of_fold_alpha) == sorted(trained)
    again = CanonicalStage(stage.settings, data.space, data.label)
    again.prepare(stage_windows(again, sequences))
    for name in ("mean", "scale", "low", "high", "weight", "bias"):
        found, expected = (getattr(x.network.regression, name) for x in (stage, again))
        torch.testing.assert_close(found, expected)
    assert stage.network.regression.weight.abs().max() > 0
    for name in trained:
        torch.testing.assert_close(stage.out_of_fold_alpha[name], again.out_of_fold_alpha[name])


def test_training_starts_from_the_estimates_of_regressions_without_the_sequence(
    trained_body_relative, sequences
):
    data, stage = sequences.data, load_stage(trained_body_relative, CanonicalStage)
    windows = data.windows("train", 3, 3)[:2]
    batch = as_tensors(sequences.batch(windows, 3, body_relative_points=True))
    names = data.name[windows[:, 0]].tolist()
    initial_alpha = torch.stack([stage.out_of_fold_alpha[name] for name in names])
    with torch.no_grad():
        trained = stage.train().estimate(batch).coefficients
        expected = stage.network(batch["points"], batch["labels"], initial_alpha).coefficients
    torch.testing.assert_close(trained, expected)
    maps = stage.network.maps(batch["points"], batch["labels"] == data.label)
    assert (stage.network.regression(maps) - initial_alpha).abs().max() > 0.1


def test_with_one_training_sequence_alpha_starts_from_the_mean_garment(sequences, caplog):
    data = sequences.data
    stage = build_canonical(sequences, CANONICAL)
    others = data.of_split("train")[1:]
    data.split = data.split.copy()
    data.split[others] = "test"
    stage.prepare(stage_windows(stage, sequences))
    assert "only one training sequence" in caplog.text
    assert not stage.out_of_fold_alpha
    assert stage.network.regression.weight.abs().max() == 0
