"""The rules that train static networks, for two epochs on a toy body."""

import json

import pytest
import torch

from drapeline.learning_data.static import StaticData
from drapeline.models.gcvae.load import load_codec
from drapeline.models.training.batches import as_tensors
from gcvae_stages import VERTICES, train_static, write_stages


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
    model, data = load_codec(folder / "best.ckpt"), StaticData(stages["data"])
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
    epochs = settings["training"]["epochs"]
    assert len((folder / "history.tsv").read_text().splitlines()) == 1 + epochs
    assert f"epoch {epochs} of {epochs}" in caplog.text


def test_a_training_that_cannot_go_on_says_so_in_one_sentence(run_rule, stages, tmp_path):
    with pytest.raises(SystemExit, match=r"drapeline: .*best\.ckpt: no such file"):
        run_rule(
            "train_svae",
            input={**stages, "conditioning": tmp_path / "nothing"},
            output=[tmp_path / "svae"],
            params={
                "settings": {"network": {"widths": [4] * 6}, "loss": {}, "training": {}},
                "trainer": {},
                "code": "c",
                "progress": str(tmp_path / ".progress"),
            },
            wildcards={"svae": "svae"},
        )
    assert not (tmp_path / "svae").exists()
