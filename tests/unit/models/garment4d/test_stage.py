"""What both stages share, on a stage with one weight."""

import pytest
import torch

from drapeline.errors import InputError
from drapeline.models.garment4d.settings import CanonicalWeights, StageSettings
from drapeline.models.garment4d.stages import Stage, distance_mm, sequence_names, window_keys
from drapeline.settings import Settings


class ToyNetwork(Settings):
    size: int = 2
    body_relative_points: bool = False


class ToySettings(StageSettings):
    network: ToyNetwork = ToyNetwork()
    loss: CanonicalWeights = CanonicalWeights()


class ToyStage(Stage):
    checkpoint_type = "toy"
    SETTINGS, ERROR = ToySettings, "toy_error_mm"

    def __init__(self, settings, space, label):
        super().__init__(settings, space, label)
        draw = self.weight_rng()
        self.weight = torch.nn.Parameter(torch.rand(settings.network.size, generator=draw))

    def losses(self, batch):
        gap = self.weight.sum() - batch["target"]
        return {"squared": gap**2, "total": 3 * gap**2}, 1000 * gap.abs()


BATCH = {"target": torch.tensor(5.0), "names": ["a/1", "b/2"]}


@pytest.fixture
def toy(data):
    return ToyStage(ToyStage.SETTINGS(**{"network": {"size": 3}}), data.space, data.label)


def test_a_step_gives_the_total_and_logs_all_terms_and_the_error(toy):
    loss = toy.training_step(BATCH)
    (logged,) = toy.logged
    assert logged.count == 2
    assert logged.values.keys() == {"train_squared", "train_total", "train_toy_error_mm"}
    assert float(logged.values["train_total"]) == float(loss.detach())
    loss.backward()
    assert toy.weight.grad.abs().min() > 0
    toy.validation_step(BATCH)
    assert toy.logged[1].values.keys() == {"val_squared", "val_total", "val_toy_error_mm"}


def test_a_loss_that_is_not_finite_is_refused(toy):
    with pytest.raises(InputError, match=r"the loss is nan .* for samples a/1, b/2"):
        toy.training_step({**BATCH, "target": torch.tensor(torch.nan)})


def test_initial_weights_depend_on_the_seed_alone(data):
    def weight(**training):
        values = {"network": {"size": 3}, "training": training}
        return ToyStage(ToyStage.SETTINGS(**values), data.space, data.label).weight

    assert torch.equal(weight(), weight(epochs=7))
    assert not torch.equal(weight(), weight(seed=1))


def test_checkpoints_hold_what_a_stage_is_built_from(toy, data):
    metadata = toy.checkpoint_metadata()
    assert (metadata["checkpoint_type"], metadata["label"]) == ("toy", data.label)
    assert ToyStage.SETTINGS(**metadata["settings"]) == toy.settings
    torch.testing.assert_close(metadata["space"]["mean"], torch.from_numpy(data.space.mean))


def test_batches_are_told_by_window_and_by_sequence():
    batch = {
        "sequence": torch.tensor([4, 4]),
        "start": torch.tensor([0, 3]),
        "names": ["a/b/10", "a/b/13"],
    }
    assert window_keys(batch) == [(4, 0), (4, 3)]
    assert sequence_names(batch) == ["a/b", "a/b"]


def test_distances_are_mean_lengths_in_millimetres():
    true = torch.zeros(2, 5, 3)
    predicted = true.clone()
    predicted[0, :, 0], predicted[0, :, 1] = 0.003, 0.004
    assert float(distance_mm(predicted, true)) == pytest.approx(2.5)
