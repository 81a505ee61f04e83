import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.models.gcvae.settings import ConditioningSettings
from toys.gcvae import ToyGarments
from toys.gcvae_trainings import Killed, assert_same, checkpoint_under_way, train_condition, weights


def test_settings_that_are_not_named_have_their_defaults():
    settings = ConditioningSettings(condition=7, training={"seed": 3})
    assert (settings.condition, settings.training.seed) == (7, 3)
    assert settings.training == ConditioningSettings().training.replace(seed=3)


def test_the_statistics_are_those_of_the_training_rows(conditioning):
    garments, state = ToyGarments(), weights(conditioning)
    cvar = garments.cvar(garments.rows("train"))
    mean, std = (state[f"autoencoder.{name}"].numpy() for name in ("mean", "std"))
    np.testing.assert_allclose(mean, cvar.mean(axis=0), atol=1e-6)
    np.testing.assert_allclose(std, cvar.std(axis=0), atol=1e-6)


class DyingConditions(ToyGarments):
    """Conditions whose reading stops the job after some batches."""

    left = 11

    def cvar(self, rows):
        self.left -= 1
        if self.left < 0:
            raise Killed
        return super().cvar(rows)


def test_a_killed_conditioning_goes_on_to_the_same_weights(conditioning, tmp_path):
    with pytest.raises(Killed):
        train_condition(tmp_path / "killed", DyingConditions())
    assert checkpoint_under_way(tmp_path / "killed_progress")
    resumed = train_condition(tmp_path / "killed", ToyGarments())
    assert_same(weights(resumed), weights(conditioning))


class SpoiltConditions(ToyGarments):
    """Conditions that are fine when first looked at and not when trained on."""

    looks = 0

    def cvar(self, rows):
        self.looks += 1
        cvar = super().cvar(rows)
        if self.looks > 1:
            cvar[np.asarray(rows) == 5, 3] = np.inf
        return cvar


def test_conditions_that_are_not_finite_stop_with_their_samples(tmp_path):
    garments = ToyGarments()
    garments.shape[5, 3] = np.nan
    with pytest.raises(InputError, match="^samples toy005: conditions hold NaN"):
        train_condition(tmp_path / "out", garments)
    with pytest.raises(InputError, match=r"epoch 0, step \d: the loss is .*toy005.*finite"):
        train_condition(tmp_path / "out", SpoiltConditions())
    assert not (tmp_path / "out").exists()
