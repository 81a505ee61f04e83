import pytest
import torch

from drapeline.errors import InputError
from drapeline.models.smplicit.network import load_field, new_field
from drapeline.models.training.checkpoints import read_checkpoint, write_checkpoint
from drapeline.models.training.module import BEST
from toys.smplicit import toy_bodies, toy_settings
from toys.smplicit_trainings import train_toy


@pytest.fixture(scope="module")
def trained(tmp_path_factory, fields, toy_body):
    return train_toy(tmp_path_factory.mktemp("trained"), fields, toy_body)


def test_a_new_model_depends_on_its_seed_alone(fields, toy_body):
    one, same, other = (
        new_field("skirt", fields, toy_bodies(toy_body), toy_settings(seed=seed))
        for seed in (0, 0, 1)
    )
    for name, value in one.state_dict().items():
        assert torch.equal(value, same.state_dict()[name]), name
    assert not torch.equal(one.decoder.fc1.weight_v, other.decoder.fc1.weight_v)
    assert one.styles.shape == (len(fields), 3)
    assert not one.styles.any()


def test_other_networks_are_refused(tmp_path, trained):
    checkpoint = read_checkpoint(trained / BEST)
    checkpoint.metadata["checkpoint_type"] = "static"
    write_checkpoint(tmp_path / BEST, *checkpoint)
    with pytest.raises(InputError, match="holds a 'static' network, expected smplicit"):
        load_field(tmp_path)
    with pytest.raises(InputError, match=rf"{BEST}: no such file"):
        load_field(tmp_path / "nowhere")


@pytest.mark.parametrize("name", ["../evil", ["skirt"], None])
def test_a_model_of_no_known_name_is_refused(tmp_path, trained, name):
    checkpoint = read_checkpoint(trained / BEST)
    checkpoint.metadata["name"] = name
    write_checkpoint(tmp_path / BEST, *checkpoint)
    with pytest.raises(InputError, match=rf"{BEST}: the model is named .*, expected upper or"):
        load_field(tmp_path)
