"""What training the garment VAEs and their conditions comes to on any processor."""

import numpy as np
import pytest

from drapeline.models.gcvae.data import cvar_statistics
from drapeline.models.gcvae.settings import ConditioningSettings
from drapeline.models.gcvae.train import ConditioningTraining
from drapeline.models.gcvae.vae import DynamicVae, StaticVae
from drapeline.models.training.batches import as_tensors
from drapeline.models.training.module import Progress
from toys import gcvae_files
from toys.gcvae import ToyGarments, toy_template
from toys.learning import (
    assert_a_step_lowers,
    assert_learned_by_heart,
    assert_mixed_precision_agrees,
    assert_true_gradients,
    doubles,
    shake_weights,
)

SETTINGS = gcvae_files.SETTINGS.replace(
    loss={"normals": 1.0},
    training={"steps": 10, "learning_rate": 0.003, "normal_parts": 2},
)
DISTANCE = SETTINGS.replace(
    loss={"normals": 0.3, "mask": 1.0, "mask_form": "bce", "offsets_form": "distance"}
)
VAES = {
    "static": (StaticVae, SETTINGS),
    "dynamic": (DynamicVae, SETTINGS),
    "static_distance": (StaticVae, DISTANCE),
    "dynamic_distance": (DynamicVae, DISTANCE),
}


def build(cls, settings, seed=0):
    if issubclass(cls, DynamicVae):
        training = settings.training.replace(version="unposed", mask=False)
        settings = settings.replace(training=training)
    settings = settings.replace(training={"seed": seed})
    return cls(settings, toy_template())


def batch_of(count, *topologies):
    """So many garments of each topology."""
    garments = ToyGarments()
    rows = [np.flatnonzero(garments.codes == topology)[:count] for topology in topologies]
    return as_tensors(garments.batch(np.concatenate(rows)))


def late(vae):
    """Late in training, when all terms have weight."""
    vae.progress = Progress(epoch=8, step=3)
    return shake_weights(vae, 0.05)


@pytest.mark.parametrize("name", ["static", "dynamic_distance"])
def test_gradients_of_the_whole_loss_by_finite_differences(name):
    vae, batch = late(build(*VAES[name])).double(), doubles(batch_of(2, 0, 1))
    assert_true_gradients(vae, lambda vae: vae.training_step(batch))
    assert_a_step_lowers(vae, lambda vae: vae.training_step(batch))


@pytest.mark.parametrize(("name", "order"), [*zip(VAES, (1, 3, 3, 1), strict=True)])
def test_mixed_precision_gives_almost_the_same_loss_and_gradient(name, order):
    cls, settings = VAES[name]
    settings = settings.replace(network={"order": order})
    vae, batch = late(build(cls, settings)), batch_of(2, 0, 1)
    assert_mixed_precision_agrees(vae, lambda vae: vae.training_step(batch), cosine=0.9)


@pytest.mark.parametrize("name", ["static", "dynamic"])
def test_the_papers_vae_learns_two_garments_by_heart(name):
    vae = build(*VAES[name]).train()
    assert_learned_by_heart(vae, batch_of(2, 0), "offsets", steps=700)


class RelatedConditions(ToyGarments):
    """Conditions that two numbers tell."""

    def cvar(self, rows):
        mix = np.random.default_rng(1).normal(size=(2, 13))
        return (self.shape[rows, :2] @ mix).astype(np.float32)


def conditioning(seed):
    settings = ConditioningSettings(condition=6, training={"seed": seed})
    return ConditioningTraining(settings, *cvar_statistics(conditions("train")["cvar"].numpy()))


def conditions(split):
    garments = RelatedConditions()
    rows = garments.rows(split)
    return as_tensors({"cvar": garments.cvar(rows), "names": garments.names(rows)})


def test_gradients_of_the_conditions_loss_by_finite_differences():
    module, batch = conditioning(0).double(), doubles(conditions("train"))
    assert_true_gradients(module, lambda module: module.training_step(batch))
    assert_a_step_lowers(module, lambda module: module.training_step(batch))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_conditions_are_learned_by_heart_and_held_out_ones_better_than_untrained(seed):
    module, held_out = conditioning(seed), conditions("val")
    before = module.autoencoder.loss(held_out["cvar"]).item()
    assert_learned_by_heart(module, conditions("train"), "loss", steps=1000)
    assert module.autoencoder.loss(held_out["cvar"]).item() < 0.5 * before
