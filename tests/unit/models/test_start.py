"""What trainings begin with: chance, or models that come with drapeline."""

import logging
from types import SimpleNamespace

import pytest
import torch

from drapeline.errors import InputError
from drapeline.models.start import ABOUT, AT_RANDOM, start_of
from drapeline.models.training.checkpoints import begin_with, write_checkpoint
from drapeline.models.training.module import BEST
from drapeline.storage import write_json


@pytest.fixture
def weights(tmp_path, monkeypatch):
    """The folder of models, one of which learned from the walk and from two samples of seed 1."""
    monkeypatch.setattr("drapeline.models.start.package_files", lambda name: tmp_path / name)
    folder = tmp_path / "drapeline" / "weights"
    (folder / "labels").mkdir(parents=True)
    about = {"seed": 1, "clips": ["walk"], "samples": ["00001", "s00003"]}
    write_json(folder / ABOUT, about)
    return folder


def experiment(*, seed=2, init="package", moving=(), resting=()):
    """Files of an experiment with samples of a clip, or at rest, in splits."""
    plans = {
        name: SimpleNamespace(sample=name, sequence=clip, split=split)
        for name, clip, split in moving
    }
    rest = {name: SimpleNamespace(sample=name, sequence="", split=split) for name, split in resting}
    return SimpleNamespace(
        config={"init": init, "seed": seed}, moving_plans=plans, resting_plans=rest
    )


def test_trainings_begin_with_chance_unless_they_are_told_otherwise(weights):
    assert start_of(experiment(init="random"), "labels") == AT_RANDOM


def test_a_model_that_knows_nothing_of_what_is_held_out_is_begun_with(weights):
    moving = [("00001", "jump", "test"), ("00002", "walk", "train")]
    files = experiment(moving=moving, resting=[("s00003", "val")])
    assert start_of(files, "labels") == {"folder": str(weights / "labels"), "reason": ""}


@pytest.mark.parametrize(
    ("held_out", "reason"),
    [
        ({"moving": [("00009", "walk", "test")]}, "learned from the clip walk"),
        ({"moving": [("00009", "walk", "val")]}, "learned from the clip walk"),
        ({"resting": [("s00003", "test")], "seed": 1}, "the sample s00003 of this seed"),
        ({"moving": [("00001", "jump", "val")], "seed": 1}, "the sample 00001 of this seed"),
    ],
)
def test_a_model_that_has_learned_from_what_is_held_out_is_not(weights, held_out, reason):
    start = start_of(experiment(**held_out), "labels")
    assert start["folder"] == ""
    assert reason in start["reason"]


def test_what_the_package_lacks_begins_with_chance(weights):
    start = start_of(experiment(), "smplicit/upper")
    assert start == {"folder": "", "reason": "no smplicit/upper comes with drapeline"}


class Net(torch.nn.Module):
    """A layer, a table of what is learned from, and a buffer."""

    def __init__(self, rows: int, width: int = 2) -> None:
        super().__init__()
        self.layer = torch.nn.Linear(width, 2)
        self.styles = torch.nn.Parameter(torch.zeros(rows, 1))
        self.register_buffer("middle", torch.zeros(2))


@pytest.fixture
def trained(tmp_path):
    net = Net(5)
    with torch.no_grad():
        net.styles += 7
        net.middle += 7
    write_checkpoint(tmp_path / BEST, net.state_dict(), {"checkpoint_type": "net"})
    return tmp_path, net


def test_weights_are_taken_and_what_belongs_to_the_data_stays(trained, caplog):
    folder, source = trained
    net = Net(3)
    with caplog.at_level(logging.INFO):
        begin_with(net, {"folder": str(folder), "reason": ""}, own=["styles"])
    assert torch.equal(net.layer.weight, source.layer.weight)
    assert net.styles.shape == (3, 1)
    assert not net.styles.any()
    assert not net.middle.any()
    assert f"begins with the weights of {folder}" in caplog.text


def test_where_it_may_not_begin_with_them_it_says_why(caplog):
    net = Net(3)
    before = net.layer.weight.clone()
    begin_with(net, {"folder": "", "reason": "it has learned from the clip walk"})
    assert torch.equal(net.layer.weight, before)
    assert "random weights: it has learned from the clip walk" in caplog.text


def test_weights_of_another_size_are_refused(trained):
    folder, _ = trained
    with pytest.raises(InputError, match=f"^init is package, but the network of {folder} is of"):
        begin_with(Net(3, width=4), {"folder": str(folder), "reason": ""}, own=["styles"])
