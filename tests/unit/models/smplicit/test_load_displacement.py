import numpy as np
import pytest
import torch

from drapeline.bodies.rest_body import rest_body
from drapeline.errors import InputError
from drapeline.models.smplicit.load_displacement import load_displacement
from drapeline.models.training.checkpoints import read_checkpoint
from drapeline.models.training.module import BEST
from toys.displacement import CLUSTERS
from toys.displacement_trainings import toy_displacement, train_toy_displacement
from toys.smplicit_trainings import train_toy


def test_the_best_weights_are_loaded(tmp_path, displacements, toy_body):
    trained = train_toy_displacement(tmp_path, displacements, toy_body)
    network = load_displacement(trained)
    assert network.name == "skirt"
    assert not network.training
    state = read_checkpoint(trained / BEST).weights
    for name, value in network.state_dict().items():
        assert torch.equal(value, state[name]), name


def test_clusters_are_those_that_it_was_made_with(displacements, toy_body):
    network = toy_displacement(displacements, toy_body)
    at_rest = network.place_basis[:1]  # of female bodies of shape zero
    expected = rest_body(toy_body, np.zeros(10))[CLUSTERS]
    np.testing.assert_allclose(at_rest[0], expected, atol=1e-5)


def test_other_files_are_refused(tmp_path, fields, toy_body):
    with pytest.raises(InputError, match=rf"{BEST}: no such file"):
        load_displacement(tmp_path / "nowhere")
    other = train_toy(tmp_path, fields, toy_body, epochs=1)
    with pytest.raises(InputError, match="holds a 'smplicit' network, expected smplicit_displ"):
        load_displacement(other)
