"""Trainings of a few steps on the toy tube."""

import json

import numpy as np
import pytest
import torch

from drapeline.errors import InputError
from drapeline.models.gcvae.load import load_codec
from drapeline.models.gcvae.settings import GcvaeLoss, GcvaeNetwork, GcvaeTraining, VaeSettings
from drapeline.models.gcvae.train import train_vae
from drapeline.models.gcvae.vae import StaticVae
from drapeline.models.training.batches import as_tensors
from drapeline.models.training.checkpoints import read_torch_file
from drapeline.models.training.lightning import TrainingRun
from drapeline.models.training.module import BEST
from toys.gcvae import ToyGarments, toy_template
from toys.gcvae_trainings import (
    CONDITIONING,
    Killed,
    assert_same,
    checkpoint_under_way,
    train_condition,
    weights,
)
from toys.histories import column
from toys.paper import printed
from toys.threads import THREADS

SETTINGS = VaeSettings(
    network=GcvaeNetwork(widths=(6, 8, 8, 10), features=12, latent=8, condition=4),
    loss=GcvaeLoss(**{**printed("gcvae.loss"), "normals": 1.0}),
    training=GcvaeTraining(steps=10, batch=8, schedule="constant", normal_parts=2),
)


@pytest.fixture
def train(tmp_path, conditioning):
    """train("name", settings, garments) -> folder of the finished training."""

    def run(name, settings=SETTINGS, garments=None, given=conditioning, **options):
        trainer = {"accelerator": "cpu", **options}
        made, progress = tmp_path / name, tmp_path / ".progress" / name
        train_vae(
            StaticVae(settings, toy_template()),
            garments or ToyGarments(),
            given,
            TrainingRun(made, progress, "c", THREADS, trainer),
        )
        return tmp_path / name

    return run


def test_the_conditioning_autoencoder_is_frozen_in_the_vae(train, conditioning):
    before, after = weights(conditioning), weights(train("svae"))
    for key, value in before.items():
        name = key.replace("autoencoder.", "conditioning.")
        torch.testing.assert_close(after[name], value)


def test_a_training_leaves_a_loadable_model_and_its_history(train, tmp_path):
    folder = train("model")
    assert sorted(p.name for p in folder.iterdir()) == [
        "best.safetensors",
        "history.tsv",
        "manifest.tsv",
        "settings.json",
        "tensorboard",
    ]
    assert not (tmp_path / ".progress" / "model").exists()
    assert json.loads((folder / "settings.json").read_text())["network"]["latent"] == 8
    header, *rows = (folder / "history.tsv").read_text().splitlines()
    assert len(rows) == 2
    assert {"epoch", "val_selection", "val_surface_error_mm", "val_mask_iou"} <= set(
        header.split("\t")
    )
    model, batch = load_codec(folder / BEST), as_tensors(ToyGarments().batch(np.arange(5)))
    assert type(model) is StaticVae
    code = model.encode(batch)
    with torch.inference_mode():
        offsets, mask = model.decode(code.mean, batch["cvar"], batch["topology"])
    assert offsets.shape == batch["offsets"].shape
    assert ((mask >= 0) & (mask <= 1)).all()


def test_weights_stay_in_32_bits_when_products_are_taken_in_16(train):
    full, mixed = weights(train("full")), weights(train("mixed", precision="bf16-mixed"))
    key = "network.encoder.code.weight"
    assert not torch.equal(full[key], mixed[key])
    assert {value.dtype for value in mixed.values() if value.is_floating_point()} == {torch.float32}


def test_the_same_seed_trains_the_same_weights_and_another_others(train):
    first, again = weights(train("first")), weights(train("again"))
    assert_same(first, again)
    settings = SETTINGS.replace(training={"seed": 1})
    other = weights(train("other", settings))
    key = "network.encoder.code.weight"
    assert not torch.allclose(first[key], other[key])


class DiesAfter(ToyGarments):
    """Garments whose reading stops the job after some batches."""

    def __init__(self, batches):
        super().__init__()
        self.left = batches

    def batch(self, rows):
        self.left -= 1
        if self.left < 0:
            raise Killed
        return super().batch(rows)


def test_a_killed_training_goes_on_to_the_same_weights(train, tmp_path):
    settings = SETTINGS.replace(training={"steps": 20})
    with pytest.raises(Killed):
        train("killed", settings, DiesAfter(16))
    assert not (tmp_path / "killed").exists()
    assert 0 < read_torch_file(checkpoint_under_way(tmp_path / ".progress" / "killed"))["epoch"] < 3
    resumed, whole = (train(name, settings) for name in ("killed", "whole"))
    assert_same(weights(resumed), weights(whole))
    for name in ("epoch", "val_selection"):
        assert column(resumed, name) == pytest.approx(column(whole, name))


def test_other_settings_begin_anew(train, tmp_path):
    with pytest.raises(Killed):
        train("model", SETTINGS, DiesAfter(7))
    assert checkpoint_under_way(tmp_path / ".progress" / "model")
    settings = SETTINGS.replace(training={"seed": 3})
    assert_same(weights(train("model", settings)), weights(train("other", settings)))


def test_another_conditioning_network_begins_anew(train, conditioning, tmp_path):
    settings = CONDITIONING.replace(training={"seed": 1})
    train_condition(tmp_path / "other", ToyGarments(), settings)
    with pytest.raises(Killed):
        train("model", SETTINGS, DiesAfter(7))
    before = checkpoint_under_way(tmp_path / ".progress" / "model")
    resumed = train("model", given=tmp_path / "other")
    assert_same(weights(resumed), weights(train("anew", given=tmp_path / "other")))
    assert not before.parent.exists()


class SpoiltLater(ToyGarments):
    """Garments whose offsets are fine when first looked at and not when trained on."""

    spoilt = 5

    def __init__(self):
        super().__init__()
        self.looks = 0

    def batch(self, rows):
        batch = super().batch(rows)
        self.looks += 1
        if self.looks > 1:
            batch["offsets"][np.asarray(rows) == self.spoilt] = np.nan
        return batch


def test_a_loss_that_is_not_finite_stops_with_the_samples_of_its_batch(train, tmp_path):
    name = SpoiltLater().names([SpoiltLater.spoilt])[0]
    with pytest.raises(InputError, match=rf"epoch 0, step \d: the loss is nan.*{name}.*finite"):
        train("model", SETTINGS, SpoiltLater())
    assert not (tmp_path / "model").exists()
