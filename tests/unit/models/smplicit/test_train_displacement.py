import pytest
import torch

from drapeline.models.training.checkpoints import read_checkpoint
from toys.displacement_trainings import train_toy_displacement


@pytest.fixture(scope="module")
def trained(tmp_path_factory, displacements, toy_body):
    return train_toy_displacement(tmp_path_factory.mktemp("trained"), displacements, toy_body)


def test_a_killed_training_is_resumed_to_the_bit(tmp_path, displacements, toy_body, trained):
    with pytest.raises((KeyboardInterrupt, SystemExit)):
        train_toy_displacement(tmp_path, displacements, toy_body, stop=5)
    assert not (tmp_path / "model").exists()
    resumed = train_toy_displacement(tmp_path, displacements, toy_body)
    one, other = (read_checkpoint(path / "last.ckpt")["state_dict"] for path in (trained, resumed))
    for name, value in one.items():
        assert torch.equal(value, other[name]), name


def test_an_epoch_sees_each_frame_once(trained):
    # Twelve frames, four at a time.
    assert read_checkpoint(trained / "last.ckpt")["global_step"] == 3 * 3
    header = (trained / "history.tsv").read_text().splitlines()[0].split("\t")
    assert {"train_vertex_error_mm", "val_vertex_error_mm", "val_loss"} <= {*header}
