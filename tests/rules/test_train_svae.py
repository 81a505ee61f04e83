"""The rules that train static networks, for two epochs on a toy body."""

import json

import numpy as np
import pytest
import torch
from scipy.spatial import KDTree

from drapeline.bodies.model import load_body
from drapeline.bodies.rest_body import rest_body
from drapeline.errors import InputError
from drapeline.learning_data.static import StaticData
from drapeline.metrics.garment import garment_mesh, surface_distances_mm
from drapeline.models.gcvae.codec import encode_garments
from drapeline.models.gcvae.load import load_codec
from drapeline.models.gcvae.static_model import StaticModel
from drapeline.models.load import load
from drapeline.models.training.batches import as_tensors
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.topology import load_topology
from toys.gcvae_stages import VERTICES, train_static, write_stages


@pytest.fixture(scope="module")
def stages(tmp_path_factory, toy_body):
    return write_stages(tmp_path_factory.mktemp("stages"), toy_body)


@pytest.mark.parametrize(
    ("variant", "checkpoint_type"),
    [("svae", "static"), ("svae_no_mask", "static"), ("static_ppca", "static_ppca")],
)
def test_a_variant_is_trained_and_decodes_held_out_garments(
    run_rule, stages, tmp_path, caplog, variant, checkpoint_type
):
    folder = train_static(run_rule, stages, tmp_path, variant)
    model, data = load_codec(folder / "best.safetensors"), StaticData(stages["data"])
    assert model.checkpoint_type == checkpoint_type
    settings = json.loads((folder / "settings.json").read_text())
    batch = as_tensors(data.batch(data.rows("test")))
    with torch.inference_mode():
        code = model.encode(batch)
        offsets, mask = model.decode(code.mean, batch["cvar"], batch["topology"])
    assert offsets.shape == (2, VERTICES, 3)
    assert torch.isfinite(offsets).all()
    assert (mask is None) == (variant == "svae_no_mask")
    assert settings["checkpoint_type"] == checkpoint_type
    if variant == "static_ppca":
        assert (settings["latent"], settings["seed"]) == (6, 0)
        return
    assert settings["training"]["mask"] == (variant != "svae_no_mask")
    epochs = 2
    assert len((folder / "history.tsv").read_text().splitlines()) == 1 + epochs
    assert f"epoch {epochs} of {epochs}" in caplog.text


@pytest.fixture(scope="module")
def fitted(run_rule, stages, tmp_path_factory):
    return load(train_static(run_rule, stages, tmp_path_factory.mktemp("fitted"), "static_ppca"))


@pytest.mark.parametrize("variant", ["svae", "static_ppca"])
def test_a_model_is_used_without_the_data_of_its_training(
    run_rule, stages, fitted, tmp_path, variant
):
    model = fitted
    if variant == "svae":
        model = load(train_static(run_rule, stages, tmp_path, variant))
    assert isinstance(model, StaticModel)
    assert model.garments == GARMENTS[:6]  # there is no jacket among the toys
    shape, tightness = np.linspace(-1, 1, 10), (-0.5, 0.2)
    wearer = {"gender": "male", "shape": shape, "tightness": tightness}
    (first,) = model.sample(1, "Tshirt", **wearer, settle=False)
    again, second = model.sample(2, "Tshirt", **wearer, settle=False)
    np.testing.assert_allclose(first.z, again.z, atol=1e-6)
    assert not np.array_equal(first.z, second.z)
    assert (first.garment, first.gender) == ("Tshirt", "male")
    np.testing.assert_array_equal(first.tightness, tightness)
    body = rest_body(load_body(stages["male"]), shape)
    np.testing.assert_allclose(first.body.vertices, body, atol=1e-5)
    # From the code alone on the same body, it is the same garment again.
    (decoded,) = model.decode(first.z[None], "Tshirt", **wearer)
    assert KDTree(decoded.mesh.vertices).query(first.mesh.vertices)[0].max() < 1e-5
    (settled,) = model.sample(1, "Tshirt", **wearer)
    (again,) = model.decode(first.z[None], "Tshirt", **wearer, settle=True)
    np.testing.assert_allclose(again.mesh.vertices, settled.mesh.vertices, atol=1e-4)
    assert np.abs(settled.mesh.vertices - first.mesh.vertices).max() > 1e-4
    for garment in model.decode(
        np.zeros((2, model.latent)), gender=["female", "male"], shape=shape
    ):
        assert garment.garment in GARMENTS


def test_meshes_are_encoded_on_their_wearers(stages, fitted):
    data = StaticData(stages["data"])
    row = int(data.rows("test")[0])
    name = GARMENTS[data.garment[row]]
    body = rest_body(load_body(stages["female"]), data.shape[row])
    topology = load_topology(stages["topology"])
    mesh = garment_mesh(body + data.offsets[row], topology.faces_of(name), data.mask[row])
    wearer = {
        "gender": "female",
        "shape": data.shape[row],
        "tightness": data.tightness[row] * [-1, 1],  # stored with the gender's sign
    }
    codes = fitted.encode([mesh, mesh], name, **wearer)
    (known,) = encode_garments(load_codec(fitted.folder / "best.safetensors"), data, [row]).mean
    assert codes.mean.shape == codes.log_variance.shape == (2, fitted.latent)
    np.testing.assert_array_equal(codes.mean[0], codes.mean[1])
    # The registration of the mesh is not quite the one that it was made of.
    assert np.linalg.norm(codes.mean[0] - known) < 0.5 * np.linalg.norm(known)
    (decoded,) = fitted.decode(codes.mean[:1], name, **wearer)
    assert max(surface_distances_mm(decoded.mesh, mesh)) < 15


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"gender": "child"}, "gender: 'child', expected one of female, male"),
        ({"gender": ["male"] * 2}, "gender: 2 values, expected one or 3"),
        ({"garments": "Sock"}, "garment: 'Sock', expected one of Tshirt, Top"),
        ({"shape": np.zeros(9)}, r"shape: values of shape \(9,\), expected \(10,\) or \(3, 10\)"),
        ({"tightness": [0, np.nan]}, "tightness: values of shape .* finite numbers"),
        ({"z": np.zeros((3, 2))}, r"codes of shape \(3, 2\), expected \(n, 6\)"),
    ],
)
def test_what_cannot_be_decoded_is_refused_in_one_sentence(fitted, changed, message):
    asked = {"z": np.zeros((3, 6)), "gender": "male", "shape": np.zeros(10), **changed}
    with pytest.raises(InputError, match=message):
        fitted.decode(asked.pop("z"), **asked)


def test_a_training_that_cannot_go_on_says_so_in_one_sentence(run_rule, stages, tmp_path):
    with pytest.raises(SystemExit, match=r"drapeline: .*best\.safetensors: no such file"):
        run_rule(
            "drapeline.models.gcvae.train:train_svae",
            input={**stages, "conditioning": tmp_path / "nothing"},
            output=[tmp_path / "svae"],
            params={
                "settings": {"network": {"widths": [4] * 6}, "loss": {}, "training": {}},
                "trainer": {},
                "code": "c",
                "progress": str(tmp_path / ".progress"),
            },
        )
    assert not (tmp_path / "svae").exists()
