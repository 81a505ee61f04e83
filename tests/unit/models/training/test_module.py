"""What all trained networks share, on a network of two numbers."""

from types import SimpleNamespace

import pytest
import torch

from drapeline.errors import InputError
from drapeline.models.training.module import (
    Logged,
    Progress,
    TrainableModule,
    fastest_device,
)
from drapeline.models.training.settings import EpochTraining


class Pair(TrainableModule):
    """One number that is trained and one that is frozen."""

    def __init__(self):
        super().__init__()
        training = EpochTraining(epochs=1, batch=1, learning_rate=0.25, schedule="constant")
        self.settings = SimpleNamespace(training=training)
        self.trained = torch.nn.Parameter(torch.tensor(1.0))
        self.frozen = torch.nn.Parameter(torch.tensor(2.0), requires_grad=False)

    def training_step(self, batch):
        return self.trained * self.frozen

    def validation_step(self, batch):
        pass

    def checkpoint_metadata(self):
        return {}


def test_networks_run_on_a_gpu_where_there_is_one_unless_the_config_says_cpu(monkeypatch):
    for there in (True, False):
        monkeypatch.setattr(torch.cuda, "is_available", lambda there=there: there)
        found = {name: fastest_device(name).type for name in ("auto", "gpu", "cpu")}
        assert found == dict.fromkeys(found, "cuda" if there else "cpu") | {"cpu": "cpu"}


def test_the_optimiser_is_adam_on_what_is_trained():
    pair = Pair()
    optimizer = pair.optimizer()
    pair.training_step({}).backward()
    optimizer.step()
    # Adam's first step is as long as the learning rate, whatever the gradient.
    torch.testing.assert_close(pair.trained.detach(), torch.tensor(0.75))
    assert float(pair.frozen) == 2
    assert [p is pair.trained for p in optimizer.param_groups[0]["params"]] == [True]


def test_means_are_logged_under_the_stage_and_hold_no_graph():
    pair = Pair()
    pair.log_means("val", {"loss": pair.training_step({})}, 5)
    (logged,) = pair.logged
    assert isinstance(logged, Logged)
    assert logged.rows == 5
    assert not logged.values["val_loss"].requires_grad
    assert float(logged.values["val_loss"]) == 2


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_loss_that_is_not_finite_stops_with_where_what_and_whose(value):
    pair = Pair()
    terms = {"normals": torch.tensor(0.25), "kl": torch.tensor(value)}
    pair.stop_if_unfinite(torch.tensor(3.0), terms, ["a"])  # the loss alone counts
    assert pair.progress == Progress(0, 0, 0)
    pair.progress = Progress(epoch=4, step=37)
    with pytest.raises(
        InputError, match=rf"epoch 4, step 37.*normals 0\.25, kl {value}.* samples a, b;"
    ):
        pair.stop_if_unfinite(torch.tensor(value), terms, ["a", "b"])
