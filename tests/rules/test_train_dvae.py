"""The rules that collect garments in motion and train on them, on a toy body."""

import numpy as np
import pytest
import torch

from drapeline.bodies.kinematics import mirror_poses
from drapeline.bodies.model import load_body
from drapeline.dataset.reader import Sample
from drapeline.frames import GENDERS
from drapeline.learning_data.dynamic import DynamicData
from drapeline.models.gcvae.load import load_codec, load_dynamic_garments
from drapeline.models.gcvae.settings import DVAE_VARIANTS
from drapeline.models.training.batches import as_tensors
from drapeline.models.training.settings import override_settings
from drapeline.registration.to_body.dynamic_offsets import load_sample_garment, points_from_offsets
from toys.gcvae_stages import SETTINGS, VERTICES, train_static, write_stages
from toys.tiny_sample import write_tiny_sample

SPLITS = {"00001": "train", "00002": "train", "00003": "val", "00004": "test"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("dvae")


@pytest.fixture(scope="module")
def stages(folder, toy_body):
    files = write_stages(folder / "stages", toy_body)
    for sample, split in SPLITS.items():
        status = "rejected" if sample == "00002" else "accepted"
        write_tiny_sample(
            folder, toy_body, sample, split=split, status=status, frames=8, seed=int(sample)
        )
    return files


@pytest.fixture(scope="module")
def collected(run_rule, stages, folder):
    """collected("posed") -> folder of the frames."""
    bodies = {gender: stages[gender] for gender in GENDERS}

    def collect(version):
        output = folder / "dynamic" / version
        if output.exists():
            return output
        run_rule(
            "register_samples",
            input={"samples": folder / "samples", "topology": stages["topology"], **bodies},
            output=[folder / "registration"],
        )
        shards = {"samples": [folder / "samples"], "registrations": [folder / "registration"]}
        run_rule(
            "collect_dynamic",
            input={**shards, **bodies},
            output=[output],
            params={"frame_step": 2},
            wildcards={"version": version},
        )
        return output

    return collect


@pytest.fixture(scope="module")
def static(run_rule, stages, folder):
    """Folder of a trained static model."""
    return train_static(run_rule, stages, folder)


@pytest.mark.parametrize("version", ["posed", "unposed"])
def test_collected_frames_are_the_simulated_garment(collected, stages, folder, version):
    data = DynamicData(collected(version))
    assert data.version == version
    assert set(data.sample) == {"00001", "00003", "00004"}  # one was rejected
    assert len(data) == 3 * 2 * 4  # samples, garments, every second of eight frames
    for key in ("offsets", "base", "poses", "mask", "static"):
        assert isinstance(getattr(data, key), np.memmap)
    body = load_body(stages["female"])
    for row in (0, 5, len(data) - 1):
        garment_index, frame = data.garment_index[row], data.frame[row]
        name = ("Tshirt", "Skirt")[int(data.garment[garment_index] == 3)]
        with Sample(folder / "samples" / data.sample[garment_index]) as sample:
            cloth = sample.vertices(name, frame="root")[frame]
            poses = sample.info.poses
        garment = load_sample_garment(
            folder / "registration" / data.sample[garment_index] / f"{name}.npz"
        )
        back = points_from_offsets(
            garment,
            data.offsets[row][None],
            body,
            data.shape[garment_index],
            data.poses[row, :1],
            version,
        )
        np.testing.assert_allclose(back[0], garment.points(cloth[None])[0], atol=1e-4)
        history = poses[np.maximum(frame - 3 * np.arange(4), 0)]
        np.testing.assert_allclose(data.poses[row], history, atol=1e-6)


@pytest.mark.parametrize(
    ("variant", "version", "frames"),
    [
        ("dvae_posed_1", "posed", 1),
        ("dvae_unposed_4", "unposed", 4),
        ("dynamic_ppca", "unposed", 4),
    ],
)
def test_a_variant_is_trained_on_poses_and_the_static_code(
    run_rule, collected, stages, static, tmp_path, variant, version, frames
):
    data = collected(version)
    fitted = variant == "dynamic_ppca"
    given = {**stages, "data": data, "static": static}
    if not fitted:
        given["conditioning"] = tmp_path / "conditioning_dynamic"
        run_rule(
            "drapeline.models.gcvae.train:train_dvae_conditioning",
            input={"data": data, "static": static},
            output=[given["conditioning"]],
            params={
                "frames": frames,
                "settings": {"condition": 4, "training": {"steps": 6}},
                "trainer": {"accelerator": "cpu"},
                "code": "c",
                "progress": str(tmp_path / ".progress" / "c"),
            },
        )
    training = {
        "settings": override_settings(SETTINGS, DVAE_VARIANTS.get(variant, {})),
        "trainer": {"accelerator": "cpu"},
        "progress": str(tmp_path / ".progress" / "d"),
    }
    run_rule(
        f"drapeline.models.gcvae.train:{'fit_dynamic_ppca' if fitted else 'train_dvae'}",
        input=given,
        output=[tmp_path / "dvae"],
        params={
            "code": "c",
            "frames": frames,
            **({"settings": {"latent": 6, "seed": 0}} if fitted else training),
        },
    )
    model = load_codec(tmp_path / "dvae" / "best.safetensors")
    garments = load_dynamic_garments(data, static, frames)
    batch = as_tensors(garments.batch(garments.rows("test")))
    assert batch["cvar"].shape == (8, 13 + 72 * frames + 6)
    assert model.resolves_penetration == fitted
    assert model.latent == 6
    if not fitted:
        assert model.settings.network.level_widths == [6, *[2 * 8] * 5]
    with torch.inference_mode():
        offsets, mask = model.decode(model.encode(batch).mean, batch["cvar"], batch["topology"])
    assert offsets.shape == (8, VERTICES, 3)
    assert torch.isfinite(offsets).all()
    assert mask is None


def test_wrinkles_are_learned_from_poses_and_the_static_code(
    run_rule, collected, stages, static, tmp_path
):
    data = collected("unposed")
    run_rule(
        "drapeline.models.gcvae.train:train_wrinkle_mlp",
        input={**stages, "data": data, "static": static},
        output=[tmp_path / "mlp"],
        params={
            "code": "c",
            "frames": 2,
            "settings": {"latent": 6, "width": 4, "training": {"steps": 3, "batch": 4}},
            "trainer": {"accelerator": "cpu"},
            "progress": str(tmp_path / ".progress" / "m"),
        },
    )
    model = load_codec(tmp_path / "mlp" / "best.safetensors")
    assert (tmp_path / "mlp" / "history.tsv").is_file()
    garments = load_dynamic_garments(data, static, 2)
    batch = as_tensors(garments.batch(garments.rows("test")))
    with torch.inference_mode():
        zero = torch.zeros(len(batch["cvar"]), model.latent)
        offsets, _ = model.decode(zero, batch["cvar"], batch["topology"])
    assert offsets.shape == (8, VERTICES, 3)
    assert torch.isfinite(offsets).all()


def test_mirrored_conditions_differ_in_the_poses_alone(collected, static):
    garments = load_dynamic_garments(collected("unposed"), static, 2)
    batch = garments.batch(np.arange(3))
    seen, poses = batch["cvar"], slice(13, 13 + 2 * 72)
    wanted = seen.copy()
    wanted[:, poses] = mirror_poses(seen[:, poses].reshape(3, 2, 72)).reshape(3, -1)
    np.testing.assert_array_equal(garments.mirrored_cvar(np.arange(3)), wanted)
