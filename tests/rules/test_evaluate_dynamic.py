"""Rules that evaluate and draw garments in motion, on toy files and an untrained network."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from drapeline.bodies.model import save_body
from drapeline.frames import GENDERS
from drapeline.learning_data.dynamic import collect_dynamic
from drapeline.metrics.table import read_metrics
from drapeline.models.gcvae.codec import Codes, save_codes
from drapeline.models.gcvae.ppca import DynamicPpca
from drapeline.models.gcvae.settings import PpcaSettings, WrinkleMlpSettings
from drapeline.models.gcvae.vae import DynamicVae, StaticVae
from drapeline.models.gcvae.wrinkle_mlp import WrinkleMlp
from drapeline.outfits.garment_types import GARMENTS
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.outfits.static import StaticOutfit
from drapeline.registration.to_body.topology import save_topology
from drapeline.storage import save_npz, write_json
from toys.gcvae_files import (
    SETTINGS,
    plain_topology,
    save_model,
    shaken,
    template_on_body,
    torso_registration,
)
from toys.metric_rows import find_value
from toys.outfits_at_rest import save_static
from toys.tiny_sample import write_tiny_sample

STATIC_CVAR = 13

FRAMES = 4


@pytest.fixture(scope="module")
def stages(toy_body, tmp_path_factory):
    """Three samples, their registrations, bodies, topology and both networks, as rule inputs."""
    made = tmp_path_factory.mktemp("stages")
    samples, registrations = [], []
    for name, split in (("00001", "train"), ("00002", "test"), ("00003", "val")):
        tiny = write_tiny_sample(made, toy_body, name, split)
        folder = made / "registration" / name
        write_json(folder / "status.json", {"id": name, "status": "accepted", "split": split})
        laid = torso_registration(toy_body, tiny.shape)
        for garment, mesh in tiny.meshes.items():
            corner = laid.corner % len(mesh.vertices)
            replace(laid, corner=corner).save(folder / f"{garment}.npz")
        samples.append(tiny.folder)
        registrations.append(folder)
    given = {"topology": made / "topology.npz"}
    topology = plain_topology(toy_body.v_template, toy_body.faces, toy_body.faces)
    save_topology(given["topology"], topology)
    for gender in GENDERS:
        for prefix in ("", "super_"):
            given[prefix + gender] = made / f"{gender}.npz"
        save_body(made / f"{gender}.npz", toy_body)
    bodies = dict.fromkeys(GENDERS, toy_body)
    pairs = dict(zip(samples, registrations, strict=True))
    collect_dynamic(made / "dynamic", pairs, bodies, version="unposed", step=2)
    save_model(
        made / "static", shaken(StaticVae(SETTINGS, template_on_body(toy_body, STATIC_CVAR)))
    )
    training = SETTINGS.training.replace(mask=False, version="unposed")
    latent = SETTINGS.network.latent
    body_template = template_on_body(toy_body, STATIC_CVAR + 72 * FRAMES + latent)
    save_model(made / "dvae", DynamicVae(SETTINGS.replace(training=training), body_template).eval())
    return {
        **given,
        "samples": [made / "samples"],
        "registrations": [made / "registration"],
        "static": made / "static",
        "dynamic": made / "dynamic",
        "data": made / "dynamic",
        "dvae": made / "dvae",
        "model": made / "dvae",
    }


def test_evaluate_dynamic_measures_held_out_frames(run_rule, stages, tmp_path):
    run_rule(
        "drapeline.models.gcvae.evaluate:evaluate_dynamic",
        input=stages,
        output=[tmp_path / "dvae"],
        params={"splits": ["test", "train"], "frames": FRAMES, "variant": "dvae_unposed_4"},
    )
    rows = read_metrics(tmp_path / "dvae/metrics.tsv")
    assert {(r.model, r.variant, r.split) for r in rows.itertuples()} == {
        ("dvae", f"dvae_unposed_4{end}", split)
        for end in ("", "_prior")
        for split in ("test", "train")
    }
    error = find_value(rows, "dvae_unposed_4", "test", "all", "surface_error_mm")
    assert error.n == 6  # every second of six frames, of two garments
    assert find_value(rows, "dvae_unposed_4", "test", "Skirt", "kl_nat") is not None
    units = find_value(rows, "dvae_unposed_4", "test", "all", "active_units")
    assert units.value == int(units.value) <= SETTINGS.network.latent
    for metric in ("kl_nat", "active_units"):
        assert find_value(rows, "dvae_unposed_4_prior", "test", "all", metric) is None


@pytest.fixture(scope="module")
def stages_of_ppca(stages, toy_body, tmp_path_factory):
    """The same with a PCA that was not fitted: all of its garments are the mean."""
    body_template = template_on_body(toy_body, STATIC_CVAR + 72 * FRAMES + SETTINGS.network.latent)
    model = DynamicPpca(PpcaSettings(latent=SETTINGS.network.latent), body_template).eval()
    folder = tmp_path_factory.mktemp("stages") / "ppca"
    save_model(folder, model)
    return {**stages, "dvae": folder, "model": folder}


@pytest.fixture(params=["paper", "ppca"])
def stages_of_either(request):
    return request.getfixturevalue("stages" if request.param == "paper" else "stages_of_ppca")


def test_a_pca_is_measured_as_decoded_and_settled(run_rule, stages_of_ppca, tmp_path):
    run_rule(
        "drapeline.models.gcvae.evaluate:evaluate_dynamic",
        input=stages_of_ppca,
        output=[tmp_path / "ppca"],
        params={"splits": ["test"], "frames": FRAMES, "variant": "dynamic_ppca"},
    )
    rows = read_metrics(tmp_path / "ppca/metrics.tsv")
    decoded, settled = (
        find_value(rows, variant, "test", "all", "surface_error_mm")
        for variant in ("dynamic_ppca", "dynamic_ppca_settled")
    )
    assert decoded.n == settled.n
    assert decoded.value != settled.value


def test_a_prediction_is_measured_without_a_code(run_rule, stages_of_ppca, toy_body, tmp_path):
    size = SETTINGS.network.latent
    template = template_on_body(toy_body, STATIC_CVAR + 72 * 2 + size)
    model = WrinkleMlp(WrinkleMlpSettings(latent=size, width=4), template).eval()
    save_model(tmp_path / "mlp", model)
    run_rule(
        "drapeline.models.gcvae.evaluate:evaluate_dynamic",
        input={**stages_of_ppca, "model": tmp_path / "mlp"},
        output=[tmp_path / "evaluated"],
        params={"splits": ["test"], "frames": 2, "variant": "wrinkle_mlp"},
    )
    rows = read_metrics(tmp_path / "evaluated/metrics.tsv")
    assert set(rows["variant"]) == {"wrinkle_mlp"}
    assert find_value(rows, "wrinkle_mlp", "test", "all", "surface_error_mm").n == 6
    assert not {"kl_nat", "active_units"} & set(rows["metric"])


def test_baselines_are_measured_on_the_same_frames(run_rule, stages, tmp_path):
    run_rule(
        "drapeline.models.gcvae.evaluate:evaluate_dynamic_baselines",
        input=stages,
        output=[tmp_path / "baselines"],
        params={"splits": ["test", "train"], "frames": FRAMES, "components": 3, "seed": 0},
    )
    rows = read_metrics(tmp_path / "baselines/metrics.tsv")
    names = "skinned_static", "skinned_mean", "skinned_mean_garment", "wrinkle_ridge", "wrinkle_pca"
    for name in names:
        assert find_value(rows, name, "test", "all", "surface_error_mm").n == 6
    assert (tmp_path / "baselines/ridge.json").is_file()
    assert find_value(rows, "moving", "test", "Tshirt", "inside_share") is not None


def test_test_garments_are_simulated_again(run_rule, stages, tmp_path):
    """By another solver than their own, whose cloth follows the body."""
    made = stages["topology"].parent
    run_rule(
        "drapeline.models.gcvae.floor:evaluate_floor",
        input={**stages, "outfits": [made / "outfits"], "motions": [made / "bodies"]},
        output=[tmp_path / "floor"],
        params={
            "solver": "toys.cloth",
            "samples": ["00001", "00002"],  # the first is of another split
            "split": "test",
            "step": 2,
            "seed": 0,
        },
    )
    rows = read_metrics(tmp_path / "floor/metrics.tsv")
    assert {(row.model, row.variant) for row in rows.itertuples()} == {
        ("truth", "again_other_solver")
    }
    error = find_value(rows, "again_other_solver", "test", "all", "surface_error_mm")
    assert error.n == 6
    assert error.value > 0


def test_figure_10_has_its_four_rows(run_rule, stages_of_either, tmp_path):
    run_rule(
        "drapeline.models.gcvae.figures:plot_wrinkles",
        input=stages_of_either,
        output=[tmp_path / "wrinkles.png"],
        params={"frames": FRAMES, "columns": 2, "seed": 0, "rays": 0.02},
    )
    with Image.open(tmp_path / "wrinkles.png") as image:
        assert 4 * 250 < image.size[1] < 5 * 250


def test_figure_7_shows_garments_at_rest_and_in_motion(
    run_rule, stages_of_either, toy_body, tmp_path
):
    shape, count = np.zeros(10), len(toy_body.v_template)
    registered = torso_registration(toy_body, shape)
    none = np.zeros((0, 3), dtype=np.float32)
    worn = Garment("Top", toy_body.v_template, toy_body.faces, *5 * [none])
    outfit = Outfit((worn,), shape, np.zeros(2), np.zeros(2), "female")
    save_static(tmp_path / "outfits_at_rest", [StaticOutfit("s00001", "test", outfit)])
    data = tmp_path / "static_data"
    data.mkdir()
    np.save(data / "offsets.npy", registered.offsets[None])
    np.save(data / "mask.npy", registered.mask[None])
    kind = np.array([GARMENTS.index("Top")])
    save_npz(
        data / "rows.npz",
        shape=shape[None],
        gender=np.zeros(1, np.int8),
        tightness=np.zeros((1, 2)),
        garment=kind,
        outfit=np.array(["s00001"]),
        split=np.array(["test"]),
    )
    moments = ("body_mean", "body_std")
    save_npz(data / "statistics.npz", **dict.fromkeys(moments, np.ones((count, 3))))
    codes = Codes(*np.zeros((2, 1, SETTINGS.network.latent), dtype=np.float32))

    class Rows:
        garment, outfit = kind, np.array(["s00001"])

        def rows(self, split):
            return np.arange(split == "test")

    (tmp_path / "evaluated").mkdir()
    save_codes(tmp_path / "evaluated/codes.npz", codes, Rows())
    run_rule(
        "drapeline.models.gcvae.figures:plot_errors",
        input={
            **stages_of_either,
            "svae": stages_of_either["static"],
            "evaluated": tmp_path / "evaluated",
            "data": data,
            "outfits": [tmp_path / "outfits_at_rest"],
        },
        output=[tmp_path / "errors.png"],
        params={"frames": FRAMES, "rays": 0.02},
    )
    with Image.open(tmp_path / "errors.png") as image:
        assert image.size[0] > 5 * 240
        assert 3 * 250 < image.size[1] < 4 * 250  # a top at rest, two garments in motion
