import numpy as np
import pytest
import torch

from drapeline.models.smplicit.model import SmplicitModel, load_training_codes
from drapeline.models.smplicit.network import load_field
from toys.smplicit_trainings import train_toy


@pytest.fixture(scope="module")
def trained(tmp_path_factory, fields, toy_body):
    return train_toy(tmp_path_factory.mktemp("trained"), fields, toy_body)


def test_the_folder_is_all_that_use_takes(trained, fields, toy_body):
    model = load_field(trained)
    assert model.name == "skirt"
    assert not any(p.requires_grad for p in model.parameters())
    codes = load_training_codes(trained)
    rows = fields.rows("train")
    with torch.no_grad():
        z_cut = model.encoder(torch.from_numpy(fields.occlusion[rows]))
    np.testing.assert_allclose(codes.z[:, :2], z_cut, atol=1e-6)
    np.testing.assert_array_equal(codes.z[:, 2:], model.styles[rows])
    assert codes.outfit.tolist() == ["s0", "s1", "s2", "s3"]
    loaded = SmplicitModel(trained)
    assert loaded.latent == 5
    np.testing.assert_array_equal(loaded.bodies["male"].v_template, toy_body.v_template)
    np.testing.assert_allclose(loaded.mean_code, codes.z.mean(axis=0))
