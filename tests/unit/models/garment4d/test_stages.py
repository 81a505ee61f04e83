"""Trainings of a few steps on toy skirts."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch

from drapeline.errors import InputError
from drapeline.models.garment4d.body_input import BodySet
from drapeline.models.garment4d.canonical import balanced
from drapeline.models.garment4d.data import SequenceData, Windows, window_starts
from drapeline.models.garment4d.stages import (
    CanonicalStage,
    MgnStage,
    PointNetStage,
    PosedStage,
    Stage,
    load_stage,
)
from drapeline.models.garment4d.train import train_canonical, train_posed
from drapeline.models.training.batches import as_tensors
from drapeline.models.training.checkpoints import read_checkpoint
from garment4d_toys import CANONICAL, PLAIN, POSED, save_toy_data, toy_bodies


@pytest.fixture(scope="module")
def folder(tmp_path_factory, toy_body):
    folder = tmp_path_factory.mktemp("garment4d")
    save_toy_data(folder / "data", toy_body)
    return folder


@pytest.fixture(scope="module")
def wearers(toy_body):
    return BodySet(toy_bodies(toy_body), 30)


@pytest.fixture
def data(folder, wearers):
    return SequenceData(folder / "data", wearers)


def run(train, folder, name, data, values, *stage, precision="32-true", **options):
    train(
        folder / name,
        data,
        values,
        *stage,
        code="c",
        progress=folder / ".progress" / name,
        trainer={"accelerator": "cpu", "precision": precision},
        threads=1,
        **options,
    )
    return folder / name


@pytest.fixture(scope="module")
def canonical(folder, wearers):
    data = SequenceData(folder / "data", wearers)
    return run(train_canonical, folder, "canonical", data, PLAIN)


@pytest.fixture(scope="module")
def body_relative_points(folder, wearers):
    data = SequenceData(folder / "data", wearers)
    return run(train_canonical, folder, "body_relative_points", data, CANONICAL)


@pytest.fixture(scope="module")
def posed(folder, wearers, canonical):
    data = SequenceData(folder / "data", wearers)
    stage = load_stage(canonical, CanonicalStage)
    return run(train_posed, folder, "posed", data, POSED, stage)


def column(folder, name):
    header, *rows = (folder / "history.tsv").read_text().splitlines()
    return [float(row.split("\t")[header.split("\t").index(name)]) for row in rows]


def windows_of(data, training, *, posed, body_relative_points):
    return Windows(
        data,
        frames=training.frames,
        stride=training.stride,
        posed=posed,
        body_relative_points=body_relative_points,
    )


def batch_of(data, stage, split):
    training = stage.settings.training
    windows = windows_of(
        data, training, posed=stage.POSED, body_relative_points=stage.body_relative_points
    )
    return as_tensors(windows.batch(windows.rows(split)))


def test_the_canonical_stage_learns_shapes_of_skirts_it_has_not_seen(canonical, data):
    errors = column(canonical, "val_canonical_error_mm")
    held = data.canonical[data.of_split("val")]
    mean_garment = 1000 * np.linalg.norm(held - data.space.mean, axis=-1).mean()
    assert min(errors) < 0.7 * mean_garment
    losses = column(canonical, "train_segmentation")
    assert losses[-1] < 0.6 * losses[0]


def test_searches_of_earlier_epochs_change_nothing(folder, canonical, data, monkeypatch):
    monkeypatch.setattr("drapeline.models.garment4d.stages._KEPT_BYTES", 0)
    searched = run(train_canonical, folder, "searched", data, PLAIN)
    for name in ("train_total", "val_total"):
        np.testing.assert_allclose(column(searched, name), column(canonical, name), rtol=1e-5)


def test_the_posed_stage_learns_the_sway_that_skinning_lacks(posed, data):
    stage = load_stage(posed, PosedStage)
    data.wear(stage.predicted_canonicals(data, ("val",)), stage.settings.skinning)
    batch = batch_of(data, stage, "val")
    assert set(data.source[batch["sequence"]]) == {"simulated", "skinned"}
    errors = column(posed, "val_vertex_error_mm")
    assert min(errors) < 0.8 * errors[0]
    proposal = 1000 * (batch["proposal"] - batch["target"]).norm(dim=-1).mean()
    assert min(errors) < 0.9 * float(proposal)


def test_a_loaded_stage_says_what_was_validated_last(posed, canonical, data):
    stage = load_stage(posed, PosedStage)
    assert not stage.training
    alone = load_stage(canonical, CanonicalStage)
    for key, value in alone.state_dict().items():
        torch.testing.assert_close(value, stage.canonical.state_dict()[key], msg=key)
    # The history's validation errors are those of the weights that were kept.
    batch = batch_of(data, alone, "val")
    with torch.inference_mode():
        terms, _ = alone.losses(batch)
    assert float(terms["total"]) == pytest.approx(min(column(canonical, "val_total")), rel=0.02)


@pytest.mark.parametrize("stage", ["canonical", "pointnet", "posed", "mgn"])
def test_mixed_precision_trains_to_about_the_same_error(
    folder, wearers, body_relative_points, stage
):
    errors = []
    for precision in ("32-true", "bf16-mixed"):
        data = SequenceData(folder / "data", wearers)
        name, training = f"{stage} {precision}", {**CANONICAL["training"], "epochs": 2}
        if stage in ("canonical", "pointnet"):
            values, pointnet = {**CANONICAL, "training": training}, stage == "pointnet"
            run(train_canonical, folder, name, data, values, pointnet=pointnet, precision=precision)
            errors.append(column(folder / name, "val_canonical_error_mm"))
        else:
            network = {"widths": [32, 32, 64]} if stage == "mgn" else POSED["network"]
            values = {**POSED, "network": network, "training": training}
            before = load_stage(body_relative_points, CanonicalStage)
            options = {"mgn": stage == "mgn", "precision": precision}
            run(train_posed, folder, name, data, values, before, **options)
            errors.append(column(folder / name, "val_vertex_error_mm"))
    np.testing.assert_allclose(errors[1], errors[0], rtol=0.15)
    assert errors[1] != errors[0]


def test_the_canonical_network_is_not_trained_further(posed, canonical):
    before = read_checkpoint(canonical / "best.ckpt")["state_dict"]
    after = read_checkpoint(posed / "last.ckpt")["state_dict"]
    for key, value in before.items():
        torch.testing.assert_close(after[f"canonical.{key}"], value, msg=key)


def test_levels_from_memory_are_those_of_the_network(posed, data, monkeypatch):
    stage = load_stage(posed, PosedStage)
    batch = batch_of(data, stage, "val")
    count = len(batch["names"])
    part = {key: value[: count - 1] for key, value in batch.items()}
    stage.kept_levels(part)
    expected = stage.levels(batch["points"]).levels
    asked = []
    levels = stage.levels
    monkeypatch.setattr(stage, "levels", lambda points: asked.append(len(points)) or levels(points))
    for _ in range(2):
        for one, true in zip(stage.kept_levels(batch), expected, strict=True):
            for x, y in zip(one, true, strict=True):
                torch.testing.assert_close(x, y)
    assert asked == [1]
    # Without room for more everything is asked for anew.
    stage._kept.clear()
    stage._room = 0
    stage.kept_levels(batch)
    stage.kept_levels(batch)
    assert asked == [1, count, count]


def test_windows_that_canonical_garments_were_predicted_from_are_not_asked_for_again(
    folder, data, posed, monkeypatch
):
    stage = load_stage(posed, PosedStage)
    found = stage.predicted_canonicals(data, ("val",))
    validated = data.of_split("val")
    np.testing.assert_array_equal(found[data.split == "test"], data.space.mean[None])
    batch = as_tensors(data.batch(data.windows("val", 3, 3), 3, posed=False))
    with torch.no_grad():
        for sequence in validated:
            part = {k: v[batch["sequence"] == sequence] for k, v in batch.items() if k == "points"}
            alpha = stage.levels(part["points"]).coefficients.mean(0).numpy()
            np.testing.assert_allclose(found[sequence], data.space.vertices(alpha), atol=1e-5)
    expected = stage.levels(batch["points"]).levels
    monkeypatch.setattr(stage, "levels", None)
    for one, true in zip(stage.kept_levels(batch), expected, strict=True):
        for x, y in zip(one, true, strict=True):
            torch.testing.assert_close(x, y)


def test_baselines_are_trained_and_loaded(folder, data, canonical):
    short = {**CANONICAL, "training": {**CANONICAL["training"], "epochs": 1}}
    out = run(train_canonical, folder, "pointnet", data, short, pointnet=True)
    stage = load_stage(out, CanonicalStage, PointNetStage)
    assert stage.kind == "garment4d_pointnet"
    posed = {"training": {**POSED["training"], "epochs": 1}, "network": {"widths": [8, 16]}}
    out = run(
        train_posed, folder, "mgn", data, posed, load_stage(canonical, CanonicalStage), mgn=True
    )
    stage = load_stage(out, MgnStage)
    assert stage.settings.skinning.neighbours == 1
    assert data.skinning == stage.settings.skinning
    # Copied weights are those of single body vertices.
    body = data.wearer(0).model.weights
    for row in data.weights(0)[::7]:
        assert np.abs(body - row).max(axis=1).min() < 1e-6


@pytest.mark.parametrize("values", [CANONICAL, PLAIN], ids=["body_relative_points", "plain"])
def test_two_trainings_end_with_the_same_weights(tmp_path, folder, wearers, values):
    short = {**values, "training": {**CANONICAL["training"], "epochs": 2}}
    ends = []
    for name in ("first", "second"):
        data = SequenceData(folder / "data", wearers)
        out = run(train_canonical, tmp_path, name, data, short)
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
        run(train, *args)


def begun(folder, name, monkeypatch, train, *args):
    """The epoch that a training of this name goes on from, 0 if it starts anew."""
    found, step = [], Stage.training_step

    def noted(stage, batch):
        found.append(stage.position.epoch)
        return step(stage, batch)

    with monkeypatch.context() as patched:
        patched.setattr(Stage, "training_step", noted)
        run(train, folder, name, *args)
    return found[0]


def test_a_killed_training_goes_on_with_the_same_data_alone(
    tmp_path, folder, wearers, toy_body, monkeypatch
):
    short = {**CANONICAL, "training": {**CANONICAL["training"], "epochs": 2}}

    def data(where=folder / "data", wearers=wearers):
        return SequenceData(where, wearers)

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
        ("fewer_body_points", 0, lambda: data(wearers=BodySet(toy_bodies(toy_body), 29))),
    ):
        killed(monkeypatch, train_canonical, tmp_path, name, data(), short)
        assert begun(tmp_path, name, monkeypatch, train_canonical, changed(), short) == start


def test_a_killed_training_goes_on_with_the_same_canonical_network_alone(
    tmp_path, data, body_relative_points, monkeypatch
):
    short = {**POSED, "training": {**POSED["training"], "epochs": 2}}
    for name, start in (("same", 1), ("other", 0)):
        stage = load_stage(body_relative_points, CanonicalStage)
        killed(monkeypatch, train_posed, tmp_path, name, data, short, stage)
        again = load_stage(body_relative_points, CanonicalStage)
        if name == "other":
            with torch.no_grad():
                again.network.encoder.coefficients.bias[0] += 1e-4
        assert begun(tmp_path, name, monkeypatch, train_posed, data, short, again) == start


def test_a_loss_that_is_not_finite_names_the_windows(folder, data):
    data.canonical = np.full_like(data.canonical, np.nan)
    with pytest.raises(InputError, match=r"loss is nan \(.*for samples 0000.*/1\d.*expected a fin"):
        run(train_canonical, folder, "nan", data, CANONICAL)
    assert not (folder / "nan").exists()


def test_weights_of_labels_come_from_the_data_and_are_loaded_again(folder, data):
    data.labels = np.where(np.arange(data.labels.shape[1]) % 3, data.labels, 0)
    values = {**CANONICAL, "training": {**CANONICAL["training"], "epochs": 1}}
    uneven = load_stage(run(train_canonical, folder, "uneven", data, values), CanonicalStage)
    expected = balanced(data.label_share("train"), 0.5)
    assert len(expected[expected > 0].unique()) > 1
    torch.testing.assert_close(uneven.label_weights, expected)


def test_maps_of_the_body_are_fitted_to_training_sequences_and_loaded_again(
    body_relative_points, data
):
    stage = load_stage(body_relative_points, CanonicalStage)
    trained = data.name[data.of_split("train")].tolist()
    assert sorted(stage.out_of_fold_alpha) == sorted(trained)
    again = CanonicalStage(stage.settings, data.space, data.label)
    again.prepare(windows_of(data, stage.settings.training, posed=False, body_relative_points=True))
    for name in ("mean", "scale", "low", "high", "weight", "bias"):
        found, expected = (getattr(x.network.regression, name) for x in (stage, again))
        torch.testing.assert_close(found, expected)
    assert stage.network.regression.weight.abs().max() > 0
    for name in trained:
        torch.testing.assert_close(stage.out_of_fold_alpha[name], again.out_of_fold_alpha[name])


def test_in_training_estimates_begin_with_what_is_left_out(body_relative_points, data):
    stage = load_stage(body_relative_points, CanonicalStage)
    windows = data.windows("train", 3, 3)[:2]
    batch = as_tensors(data.batch(windows, 3, posed=False, body_relative_points=True))
    names = data.name[windows[:, 0]].tolist()
    initial_alpha = torch.stack([stage.out_of_fold_alpha[name] for name in names])
    with torch.no_grad():
        trained = stage.train().estimated(batch).coefficients
        expected = stage.network(batch["points"], batch["labels"], initial_alpha).coefficients
    torch.testing.assert_close(trained, expected)
    maps = stage.network.maps(batch["points"], batch["labels"] == data.label)
    assert (stage.network.regression(maps) - initial_alpha).abs().max() > 0.1


def test_proposals_of_training_garments_begin_with_what_is_left_out(body_relative_points, data):
    stage = PosedStage(
        PosedStage.settings_of(POSED), load_stage(body_relative_points, CanonicalStage)
    )
    found = stage.predicted_canonicals(data, ("train", "val"))
    for split in ("train", "val"):
        sequence = int(data.of_split(split)[0])
        name = str(data.name[sequence])
        points = torch.from_numpy(data.clouds(sequence, body_relative_points=True))
        starts = window_starts(len(points), 3, 3, name)
        windows = torch.stack([points[start : start + 3] for start in starts])
        initial_alpha = None
        if split == "train":
            initial_alpha = stage.canonical.out_of_fold_alpha[name].expand(len(windows), -1)
        with torch.no_grad():
            alpha = (
                stage.canonical.network(windows, None, initial_alpha).coefficients.mean(0).numpy()
            )
        np.testing.assert_allclose(found[sequence], data.space.vertices(alpha), atol=1e-4)


def test_one_training_sequence_begins_with_the_mean_garment(data, caplog):
    stage = CanonicalStage(CanonicalStage.settings_of(CANONICAL), data.space, data.label)
    others = data.of_split("train")[1:]
    data.split = data.split.copy()
    data.split[others] = "test"
    stage.prepare(windows_of(data, stage.settings.training, posed=False, body_relative_points=True))
    assert "one training sequence" in caplog.text
    assert not stage.out_of_fold_alpha
    assert stage.network.regression.weight.abs().max() == 0


def test_settings_come_from_plain_values_and_go_back(canonical):
    about = read_checkpoint(canonical / "best.ckpt")["drapeline"]
    settings = CanonicalStage.settings_of(about["settings"])
    assert settings == CanonicalStage.settings_of(PLAIN)
    assert json.loads((canonical / "settings.json").read_text())["loss"] == {
        **about["settings"]["loss"]
    }
    assert settings.training == replace(settings.training, sources=("simulated", "skinned"))
    scaled = CanonicalStage.settings_of({"network": {"points": 1000, "width": 0.25}}).network
    assert scaled.garment[0].widths[0] == (8, 8)
    for given, points in ((None, 250), (700, 700)):
        values = {"points": 1000, "width": 1.0, "garment_points": given}
        assert CanonicalStage.settings_of({"network": values}).network.garment_points == points


def test_the_released_loss_of_the_posed_stage_sees_the_garment_alone(data, canonical):
    stage = load_stage(canonical, CanonicalStage)
    values = {**POSED, "loss": {"laplacian_form": "released"}}
    posed = PosedStage(PosedStage.settings_of(values), stage)
    batch = as_tensors(data.batch(data.windows("val", 3, 3), 3, posed=True))
    with torch.no_grad():
        terms, _ = posed.losses(batch)
        others, _ = posed.losses({**batch, "target": 2 * batch["target"]})
    torch.testing.assert_close(terms["laplacian"], others["laplacian"])
    assert float(terms["laplacian"]) > 0
    assert float(terms["vertices"]) != pytest.approx(float(others["vertices"]))


def test_unknown_settings_and_wrong_kinds_are_refused(canonical, tmp_path):
    with pytest.raises(InputError, match="CanonicalWeights: no setting 'laplace', expected one of"):
        CanonicalStage.settings_of({"loss": {"laplace": 1.0}})
    with pytest.raises(InputError, match="holds a 'garment4d_canonical' network, expected"):
        load_stage(canonical, PosedStage, MgnStage)
    with pytest.raises(InputError, match="no such file"):
        load_stage(tmp_path, PosedStage)
