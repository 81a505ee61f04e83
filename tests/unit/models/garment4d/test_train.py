"""Whole trainings of a few steps on toy skirts."""

import shutil

import numpy as np
import pytest
import torch

from drapeline.errors import InputError
from drapeline.models.garment4d.canonical_stage import CanonicalStage, PointNetStage
from drapeline.models.garment4d.load import load_stage
from drapeline.models.garment4d.posed_stage import MgnStage, PosedStage
from drapeline.models.garment4d.stage import Stage
from drapeline.models.training.checkpoints import read_checkpoint
from drapeline.models.training.module import BEST
from toys.garment4d import CANONICAL, PLAIN, POSED, open_toy_data
from toys.garment4d_stages import build_canonical, train_toys
from toys.paper import printed


def shortened(values, epochs):
    return {**values, "training": {**CANONICAL["training"], "epochs": epochs}}


def test_weights_stay_in_32_bits_when_products_are_taken_in_16(tmp_path, sequences):
    ends = []
    for precision in ("32-true", "bf16-mixed"):
        stage = build_canonical(sequences, shortened(CANONICAL, 1))
        out = train_toys(tmp_path, precision, stage, sequences, precision=precision)
        ends.append(read_checkpoint(out / BEST).weights)
    key = "network.encoder.coefficients.weight"
    assert not torch.equal(ends[0][key], ends[1][key])
    assert {value.dtype for value in ends[1].values() if value.is_floating_point()} == {
        torch.float32
    }


def test_baselines_are_trained_and_loaded(tmp_path, sequences, trained_canonical):
    stage = build_canonical(sequences, shortened(CANONICAL, 1), PointNetStage)
    out = train_toys(tmp_path, "pointnet", stage, sequences)
    stage = load_stage(out, CanonicalStage, PointNetStage)
    assert stage.checkpoint_type == "garment4d_pointnet"
    values = shortened({"network": {"widths": [8, 16]}, "loss": printed("garment4d.posed.loss")}, 1)
    stage = MgnStage(MgnStage.SETTINGS(**values), load_stage(trained_canonical, CanonicalStage))
    out = train_toys(tmp_path, "mgn", stage, sequences)
    stage = load_stage(out, MgnStage)
    assert stage.settings.skinning.neighbours == 1
    dressed = stage.training_sequences(sequences)
    # Copied weights are those of single body vertices.
    body = dressed.body(0).model.weights
    for row in dressed.weights(0)[::7]:
        assert np.abs(body - row).max(axis=1).min() < 1e-6


@pytest.mark.parametrize("values", [CANONICAL, PLAIN], ids=["body_relative_points", "plain"])
def test_two_trainings_end_with_the_same_weights(tmp_path, folder, opened, toy_body, values):
    ends = []
    for name in ("first", "second"):
        sequences = open_toy_data(folder / "data", toy_body, 30)
        stage = build_canonical(sequences, shortened(values, 2))
        out = train_toys(tmp_path, name, stage, sequences)
        ends.append(read_checkpoint(out / BEST).weights)
    for key, value in ends[0].items():
        torch.testing.assert_close(value, ends[1][key], msg=key)


class Killed(Exception):
    """Stands for the signal."""


def kill_training(monkeypatch, *args):
    """Stop a training after its first epoch."""
    step = Stage.training_step

    def stop(stage, batch):
        if stage.progress.epoch == 1:
            raise Killed
        return step(stage, batch)

    with monkeypatch.context() as patched, pytest.raises(Killed):
        patched.setattr(Stage, "training_step", stop)
        train_toys(*args)


def first_epoch(monkeypatch, *args):
    """The epoch that a training of this name goes on from, 0 if it starts anew."""
    epochs, step = [], Stage.training_step

    def noted(stage, batch):
        epochs.append(stage.progress.epoch)
        return step(stage, batch)

    with monkeypatch.context() as patched:
        patched.setattr(Stage, "training_step", noted)
        train_toys(*args)
    return epochs[0]


def test_a_killed_training_goes_on_with_the_same_data_alone(
    tmp_path, folder, sequences, toy_body, monkeypatch
):
    def moved():
        """One point of one frame elsewhere."""
        copy = tmp_path / "moved data"
        shutil.copytree(folder / "data", copy)
        points = np.load(copy / "points.npy", mmap_mode="r+")
        points[5, 7] += 0.01
        points.flush()
        return open_toy_data(copy, toy_body, 30)

    for name, epoch, changed in (
        ("same", 1, lambda: open_toy_data(folder / "data", toy_body, 30)),
        ("moved", 0, moved),
        ("fewer_body_points", 0, lambda: open_toy_data(folder / "data", toy_body, 29)),
    ):
        values, again = shortened(CANONICAL, 2), changed()
        stage = build_canonical(sequences, values)
        kill_training(monkeypatch, tmp_path, name, stage, sequences)
        stage = build_canonical(again, values)
        assert first_epoch(monkeypatch, tmp_path, name, stage, again) == epoch


def test_a_killed_training_goes_on_with_the_same_canonical_network_alone(
    tmp_path, sequences, trained_body_relative, monkeypatch
):
    settings = PosedStage.SETTINGS(**shortened(POSED, 2))
    for name, epoch in (("same", 1), ("other", 0)):
        canonical = load_stage(trained_body_relative, CanonicalStage)
        stage = PosedStage(settings, canonical)
        kill_training(monkeypatch, tmp_path, name, stage, sequences)
        again = load_stage(trained_body_relative, CanonicalStage)
        if name == "other":
            with torch.no_grad():
                again.network.encoder.coefficients.bias[0] += 1e-4
        stage = PosedStage(settings, again)
        assert first_epoch(monkeypatch, tmp_path, name, stage, sequences) == epoch


def test_a_loss_that_is_not_finite_names_the_windows(tmp_path, sequences):
    stage = build_canonical(sequences, CANONICAL)
    sequences.data.canonical = np.full_like(sequences.data.canonical, np.nan)
    with pytest.raises(InputError, match=r"loss is nan \(.*for samples 0000.*/1\d.*expected a fin"):
        train_toys(tmp_path, "nan", stage, sequences)
    assert not (tmp_path / "nan").exists()
