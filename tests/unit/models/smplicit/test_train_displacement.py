import pytest
import torch

from drapeline.models.training.checkpoints import read_checkpoint
from drapeline.models.training.module import BEST
from toys.displacement_trainings import train_toy_displacement
from toys.histories import column


@pytest.fixture(scope="module")
def trained(tmp_path_factory, displacements, toy_body):
    return train_toy_displacement(tmp_path_factory.mktemp("trained"), displacements, toy_body)


def test_a_killed_training_is_resumed_to_the_bit(tmp_path, displacements, toy_body, trained):
    with pytest.raises((KeyboardInterrupt, SystemExit)):
        train_toy_displacement(tmp_path, displacements, toy_body, stop=5)
    assert not (tmp_path / "model").exists()
    resumed = train_toy_displacement(tmp_path, displacements, toy_body)
    one, other = (read_checkpoint(path / BEST).weights for path in (trained, resumed))
    for name, value in one.items():
        assert torch.equal(value, other[name]), name
    assert column(trained, "val_loss") == column(resumed, "val_loss")


def test_an_epoch_sees_each_frame_once(tmp_path, displacements, toy_body, trained):
    steps = 3 * 3  # epochs; twelve frames, four at a time
    with pytest.raises((KeyboardInterrupt, SystemExit)):
        train_toy_displacement(tmp_path, displacements, toy_body, stop=steps - 1)
    train_toy_displacement(tmp_path, displacements, toy_body, stop=steps)
    header = (trained / "history.tsv").read_text().splitlines()[0].split("\t")
    assert {"train_vertex_error_mm", "val_vertex_error_mm", "val_loss"} <= {*header}
