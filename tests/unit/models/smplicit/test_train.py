import numpy as np
import pytest
import torch

from drapeline.errors import InputError
from drapeline.learning_data.garment_fields import FieldData
from drapeline.models.smplicit.files import load_training_codes, save_model_files
from drapeline.models.smplicit.load import load_field, new_field
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.train import train_field
from drapeline.models.training.checkpoints import read_checkpoint
from portability import THREADS
from smplicit_toys import toy_bodies, toy_settings


def train(folder, data, body, *, stop=None, **training):
    """The folder of a training; `stop` is a step at which it is killed."""
    bodies = toy_bodies(body)
    settings = toy_settings(**{"epochs": 3, "visits": 2, **training})
    model = new_field("skirt", data, bodies, settings)
    if stop is not None:
        step, whole = [0], model.training_step

        def limited(batch):
            if step[0] == stop:
                raise KeyboardInterrupt
            step[0] += 1
            return whole(batch)

        model.training_step = limited
    train_field(
        folder / "model",
        model,
        data,
        code="x",
        progress=folder / "progress",
        trainer={"accelerator": "cpu"},
        threads=THREADS,
        complete=lambda out: save_model_files(out, model, data, bodies),
    )
    return folder / "model"


@pytest.fixture(scope="module")
def trained(tmp_path_factory, fields, toy_body):
    return train(tmp_path_factory.mktemp("trained"), fields, toy_body)


def test_a_killed_training_is_resumed_to_the_bit(tmp_path, fields, toy_body, trained):
    with pytest.raises((KeyboardInterrupt, SystemExit)):
        train(tmp_path, fields, toy_body, stop=6)
    assert not (tmp_path / "model").exists()
    resumed = train(tmp_path, fields, toy_body)
    one, other = (read_checkpoint(path / "last.ckpt")["state_dict"] for path in (trained, resumed))
    for name, value in one.items():
        assert torch.equal(value, other[name]), name


def test_each_garment_is_visited_as_often_as_asked(trained):
    rows = (trained / "history.tsv").read_text().splitlines()
    assert len(rows) == 4
    # Four garments, twice each, two at a time.
    assert read_checkpoint(trained / "last.ckpt")["global_step"] == 3 * 4


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


def test_data_that_are_not_finite_are_named(tmp_path, fields, toy_body):
    for path in fields.folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    distances = np.load(tmp_path / "near_distance.npy")
    distances[2, 3] = np.nan
    np.save(tmp_path / "near_distance.npy", distances)
    with pytest.raises(InputError, match="samples s2/Skirt: distances hold NaN"):
        train(tmp_path, FieldData(tmp_path), toy_body)


def test_other_networks_are_refused(tmp_path, trained):
    checkpoint = read_checkpoint(trained / "best.ckpt")
    checkpoint["drapeline"]["checkpoint_type"] = "static"
    torch.save(checkpoint, tmp_path / "best.ckpt")
    with pytest.raises(InputError, match="holds a 'static' network, expected smplicit"):
        load_field(tmp_path)
    with pytest.raises(InputError, match=r"best\.ckpt: no such file"):
        load_field(tmp_path / "nowhere")
