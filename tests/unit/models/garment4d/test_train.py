"""Whole trainings of a few steps on toy skirts."""

import shutil

import numpy as np
import pytest
import torch

from drapeline.errors import InputError
from drapeline.models.garment4d.body_input import BodySet
from drapeline.models.garment4d.canonical_stage import CanonicalStage, PointNetStage
from drapeline.models.garment4d.data import SequenceData
from drapeline.models.garment4d.load import load_stage
from drapeline.models.garment4d.posed_stage import MgnStage
from drapeline.models.garment4d.stage import Stage
from drapeline.models.garment4d.train import train_canonical, train_posed
from drapeline.models.training.checkpoints import read_checkpoint
from garment4d_stages import column, run_training
from garment4d_toys import CANONICAL, PLAIN, POSED, toy_bodies


@pytest.mark.parametrize("stage", ["canonical", "pointnet", "posed", "mgn"])
def test_mixed_precision_trains_to_about_the_same_error(
    tmp_path, folder, bodies, trained_body_relative, stage
):
    errors, training = [], {**CANONICAL["training"], "epochs": 2}
    for precision in ("32-true", "bf16-mixed"):
        data = SequenceData(folder / "data", bodies)
        if stage in ("canonical", "pointnet"):
            train, error, before = train_canonical, "canonical_error_mm", []
            values, options = CANONICAL, {"pointnet": stage == "pointnet"}
        else:
            train, error = train_posed, "vertex_error_mm"
            before = [load_stage(trained_body_relative, CanonicalStage)]
            network = {"widths": [32, 32, 64]} if stage == "mgn" else POSED["network"]
            values, options = {**POSED, "network": network}, {"mgn": stage == "mgn"}
        values = {**values, "training": training}
        out = run_training(
            train, tmp_path, precision, data, values, *before, precision=precision, **options
        )
        errors.append(column(out, f"val_{error}"))
    np.testing.assert_allclose(errors[1], errors[0], rtol=0.15)
    assert errors[1] != errors[0]


def test_baselines_are_trained_and_loaded(tmp_path, data, trained_canonical):
    short = {**CANONICAL, "training": {**CANONICAL["training"], "epochs": 1}}
    out = run_training(train_canonical, tmp_path, "pointnet", data, short, pointnet=True)
    stage = load_stage(out, CanonicalStage, PointNetStage)
    assert stage.kind == "garment4d_pointnet"
    posed = {"training": {**POSED["training"], "epochs": 1}, "network": {"widths": [8, 16]}}
    out = run_training(
        train_posed,
        tmp_path,
        "mgn",
        data,
        posed,
        load_stage(trained_canonical, CanonicalStage),
        mgn=True,
    )
    stage = load_stage(out, MgnStage)
    assert stage.settings.skinning.neighbours == 1
    assert data.skinning == stage.settings.skinning
    # Copied weights are those of single body vertices.
    body = data.wearer(0).model.weights
    for row in data.weights(0)[::7]:
        assert np.abs(body - row).max(axis=1).min() < 1e-6


@pytest.mark.parametrize("values", [CANONICAL, PLAIN], ids=["body_relative_points", "plain"])
def test_two_trainings_end_with_the_same_weights(tmp_path, folder, bodies, values):
    short = {**values, "training": {**CANONICAL["training"], "epochs": 2}}
    ends = []
    for name in ("first", "second"):
        data = SequenceData(folder / "data", bodies)
        out = run_training(train_canonical, tmp_path, name, data, short)
        ends.append(read_checkpoint(out / "last.ckpt")["state_dict"])
    for key, value in ends[0].items():
        torch.testing.assert_close(value, ends[1][key], msg=key)


class Killed(Exception):
    """Stands for the signal."""


def killed(monkeypatch, train, *args):
    """Stop a training after its first epoch."""

    step = Stage.training_step

    def stop(stage, batch):
        if stage.position.epoch == 1:
            raise Killed
        return step(stage, batch)

    with monkeypatch.context() as patched, pytest.raises(Killed):
        patched.setattr(Stage, "training_step", stop)
        run_training(train, *args)


def begun(folder, name, monkeypatch, train, *args):
    """The epoch that a training of this name goes on from, 0 if it starts anew."""
    found, step = [], Stage.training_step

    def noted(stage, batch):
        found.append(stage.position.epoch)
        return step(stage, batch)

    with monkeypatch.context() as patched:
        patched.setattr(Stage, "training_step", noted)
        run_training(train, folder, name, *args)
    return found[0]


def test_a_killed_training_goes_on_with_the_same_data_alone(
    tmp_path, folder, bodies, toy_body, monkeypatch
):
    short = {**CANONICAL, "training": {**CANONICAL["training"], "epochs": 2}}

    def data(where=folder / "data", bodies=bodies):
        return SequenceData(where, bodies)

    def moved():
        """One point of one frame elsewhere."""
        copy = tmp_path / "moved"
        shutil.copytree(folder / "data", copy)
        points = np.load(copy / "points.npy", mmap_mode="r+")
        points[5, 7] += 0.01
        points.flush()
        return data(copy)

    for name, start, changed in (
        ("same", 1, data),
        ("moved", 0, moved),
        ("fewer_body_points", 0, lambda: data(bodies=BodySet(toy_bodies(toy_body), 29))),
    ):
        killed(monkeypatch, train_canonical, tmp_path, name, data(), short)
        assert begun(tmp_path, name, monkeypatch, train_canonical, changed(), short) == start


def test_a_killed_training_goes_on_with_the_same_canonical_network_alone(
    tmp_path, data, trained_body_relative, monkeypatch
):
    short = {**POSED, "training": {**POSED["training"], "epochs": 2}}
    for name, start in (("same", 1), ("other", 0)):
        stage = load_stage(trained_body_relative, CanonicalStage)
        killed(monkeypatch, train_posed, tmp_path, name, data, short, stage)
        again = load_stage(trained_body_relative, CanonicalStage)
        if name == "other":
            with torch.no_grad():
                again.network.encoder.coefficients.bias[0] += 1e-4
        assert begun(tmp_path, name, monkeypatch, train_posed, data, short, again) == start


def test_a_loss_that_is_not_finite_names_the_windows(tmp_path, data):
    data.canonical = np.full_like(data.canonical, np.nan)
    with pytest.raises(InputError, match=r"loss is nan \(.*for samples 0000.*/1\d.*expected a fin"):
        run_training(train_canonical, tmp_path, "nan", data, CANONICAL)
    assert not (tmp_path / "nan").exists()
