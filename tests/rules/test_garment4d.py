"""The rules that train, evaluate and use Garment4D, on toy skirts."""

import shutil

import numpy as np
import pytest
from PIL import Image

from drapeline.bodies.model import save_body
from drapeline.dataset.reader import Sample
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.metrics.predictions import load_reconstruction
from drapeline.metrics.table import read_metrics
from drapeline.models.garment4d.ours.labels import LabelStage
from drapeline.models.garment4d.ours.model import OurModel
from drapeline.models.garment4d.reconstruct import NetworksModel
from drapeline.models.garment4d.settings import MGN_VARIANTS, POSED_VARIANTS
from drapeline.models.garment4d.stages import CanonicalStage, MgnStage, PosedStage, load_stage
from drapeline.models.load import load
from drapeline.models.start import AT_RANDOM
from drapeline.models.training.checkpoints import read_checkpoint, write_checkpoint
from drapeline.models.training.module import BEST
from drapeline.models.training.settings import override_settings
from toys.garment4d import CANONICAL, GARMENT, LABELLING, POSED, save_toy_data, save_toy_tops
from toys.metric_rows import find_value

BODY_POINTS = 30
SHORT = {"epochs": 1, "batch": 4, "frames": 3, "stride": 1}
MGN = {"network": {"widths": [8, 16]}, "training": SHORT}


@pytest.fixture(scope="module")
def folder(tmp_path_factory, toy_body):
    folder = tmp_path_factory.mktemp("garment4d_rules")
    for gender in GENDERS:
        save_body(folder / f"{gender}.npz", toy_body)
    return folder


@pytest.fixture(scope="module")
def sequences(folder, toy_body):
    save_toy_tops(folder / "labelled", toy_body)
    return save_toy_data(folder / "data", toy_body)


@pytest.fixture
def bodies(folder):
    return {gender: folder / f"{gender}.npz" for gender in GENDERS}


@pytest.fixture
def trained(run_rule, folder, bodies, sequences):
    """trained("posed") -> folder of the training."""

    def train(name):
        output = folder / name
        if not output.exists():
            if name in ("labels", "ours"):
                task, given, params = ours(name)
            else:
                task, given, params = papers(name)
            run_rule(
                f"drapeline.models.garment4d.{task}",
                input=given,
                output=[output],
                params={**params, "code": "c", "progress": str(folder / ".progress" / name)},
            )
        return output

    def papers(name):
        canonical = name in ("canonical", "pointnet")
        settings = {
            "canonical": CANONICAL,
            "pointnet": {**CANONICAL, "training": SHORT},
            **dict.fromkeys(MGN_VARIANTS, MGN),
        }.get(name, {**POSED, "training": SHORT})
        changes = {**POSED_VARIANTS, **MGN_VARIANTS}.get(name, {})
        given = {"data": folder / "data", **bodies}
        params = {
            "settings": override_settings(settings, changes),
            "body_points": BODY_POINTS,
            "trainer": {"accelerator": "cpu"},
        }
        if canonical:
            return "train:train_canonical", given, {**params, "pointnet": name == "pointnet"}
        given["canonical"] = train("canonical")
        return "train:train_posed", given, {**params, "mgn": name in MGN_VARIANTS}

    def ours(name):
        if name == "labels":
            params = {"settings": LABELLING, "trainer": {"accelerator": "cpu"}, "start": AT_RANDOM}
            return "ours.train:train_labels", {"data": folder / "labelled", **bodies}, params
        given = {"data": folder / "data", "clouds": folder / "labelled", **bodies}
        given["labels"] = train("labels")
        params = {
            "body_points": BODY_POINTS,
            "skinning": POSED["skinning"],
            "refine": {},
            "proposals": "skinned",
            "accelerator": "cpu",
        }
        return "ours.train:train_ours", given, params

    return train


def test_stages_and_variants_are_trained_and_can_be_loaded(trained):
    assert load_stage(trained("canonical"), CanonicalStage).checkpoint_type == "garment4d_canonical"
    assert load_stage(trained("mgn"), MgnStage).network.last.out_features % 3 == 0
    plain = load_stage(trained("posed"), PosedStage)
    variant = load_stage(trained("no_body_encoder"), PosedStage)
    assert (len(plain.network.body), len(variant.network.body)) == (1, 0)


def test_labels_are_trained_for_all_types_and_our_model_is_fitted_with_them(trained):
    labels = load_stage(trained("labels"), LabelStage)
    model = OurModel(trained("ours"), "cpu")
    found = model.guesser.labels.state_dict()
    for name, value in labels.state_dict().items():
        assert found[name].equal(value), name
    assert model.guesser.regression.weight.any()
    assert model.final_step.correction is not None
    assert model.final_step.statistics is not None
    assert model.final_step.skinning.plain().items() >= POSED["skinning"].items()
    assert model.final_step.simulated_error_m is None


@pytest.mark.parametrize(("name", "kind"), [("ours", OurModel), ("posed", NetworksModel)])
def test_a_trained_model_is_loaded_without_its_data(trained, worn, name, kind):
    model = load(trained(name))
    assert type(model) is kind
    sequence, trans = worn
    points = sequence.points + trans[:, None]
    made = model.reconstruct(points, sequence.poses, sequence.shape, trans=trans, least_share=0)
    assert made.garment == model.garment == GARMENT
    assert made.vertices.shape == (len(trans), *sequence.canonical.shape)
    assert np.isfinite(made.vertices).all()
    with pytest.raises(InputError, match="holds a 'garment4d_canonical' network, expected static"):
        load(trained("canonical"))


def test_a_damaged_folder_of_sequences_ends_a_training_with_one_sentence(
    run_rule, folder, bodies, sequences, tmp_path
):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "about.json").write_bytes((folder / "data" / "about.json").read_bytes())
    with pytest.raises(SystemExit, match=r"drapeline: .*space.npz: no such file, expected an .npz"):
        run_rule(
            "drapeline.models.garment4d.train:train_canonical",
            input={"data": tmp_path / "data", **bodies},
            output=[tmp_path / "canonical"],
            params={
                "pointnet": False,
                "settings": CANONICAL,
                "body_points": 30,
                "trainer": {"accelerator": "cpu"},
                "code": "c",
                "progress": "none",
            },
        )
    assert not (tmp_path / "canonical").exists()


def test_all_variants_are_measured_and_pictured(run_rule, trained, folder, bodies, tmp_path):
    inputs = {name: trained(name) for name in ("canonical", "pointnet", "mgn", "ours")}
    run_rule(
        "drapeline.models.garment4d.evaluate:evaluate_garment",
        input={
            **{"data": folder / "data", **bodies, **inputs},
            "posed": [trained(name) for name in ("posed", "mgn_pulled")],
        },
        output=[tmp_path / "evaluated"],
        params={
            "posed": ["posed", "mgn_pulled"],
            "splits": ["test"],
            "settings": {"neighbours": [1], "missing": [0.5], "accuracy": [0.7], "seed": 3},
            "accelerator": "cpu",
            "refine": {"rounds": 2},
            "body_points": BODY_POINTS,
        },
    )
    rows = read_metrics(tmp_path / "evaluated/metrics.tsv")
    for variant in (
        *("posed", "mgn", "mgn_pulled", "lbs"),
        *("ours", "ours_proposals", "ours_true_labels", "ours_true_rest"),
        *("neighbours_1", "posed_missing_50", "lbs_accuracy_70", "ours_body_noise_50"),
        *("mgn_point_noise_10", "ours_views_1", "ours_undegraded"),
    ):
        assert find_value(rows, variant, "test", GARMENT, "vertex_error_mm").value > 0
    for name, variant in (("00008", "posed"), ("00008_ours", "ours")):
        shown = load_reconstruction(tmp_path / f"evaluated/reconstructions/{name}.npz")
        error = 1000 * np.linalg.norm(shown.final - shown.true, axis=-1).mean()
        measured = find_value(rows, variant, "test", GARMENT, "vertex_error_mm")
        assert measured.value == pytest.approx(error, rel=1e-4)


@pytest.fixture
def worn(sequences):
    """The held-out sequence, and where its body walks."""
    trans = np.array([0.5, -0.2, 0.9]) + 0.01 * np.arange(len(sequences[-1].poses))[:, None]
    return sequences[-1], trans


@pytest.fixture
def reconstruct(run_rule, trained, worn, tmp_path):
    """reconstruct(points) -> output files; the points (F, P, 3) are root-relative."""

    def run(points, fps=30, model=None):
        sequence, trans = worn
        frames = len(points)
        np.savez(tmp_path / "scans.npz", points=points + trans[:frames, None])
        np.savez(
            tmp_path / "body.npz",
            poses=sequence.poses[:frames],
            trans=trans[:frames],
            shape=sequence.shape,
            gender="female",
        )
        output = {
            "sample": tmp_path / GARMENT,
            "metrics": tmp_path / "metrics.tsv",
            "shown": tmp_path / "shown.npz",
        }
        run_rule(
            "reconstruct_garment",
            input={
                "points": tmp_path / "scans.npz",
                "body": tmp_path / "body.npz",
                "model": model or trained("ours"),
            },
            output=output,
            params={
                "garment": GARMENT,
                "up": "z",
                "fps": fps,
                "refine": {"rounds": 3},
                "colour": [0.4, 0.5, 0.7],
                "seed": 0,
            },
        )
        return output

    return run


def test_scans_become_a_sample_its_errors_and_pictures(run_rule, reconstruct, worn, tmp_path):
    sequence, trans = worn
    made = reconstruct(sequence.points)
    with Sample(made["sample"]) as sample:
        assert list(sample.garments) == [GARMENT]
        assert len(sample.mesh(GARMENT).faces) == len(sequence.original.faces)
        cloth = sample.vertices(GARMENT)
    true = sequence.garment() + trans[:, None]
    error = np.linalg.norm(cloth - true, axis=-1).mean()
    assert error < 0.5 * np.linalg.norm(cloth[:, ::-1] - true, axis=-1).mean()
    shown = load_reconstruction(made["shown"])
    assert len(shown.true) == 0
    np.testing.assert_allclose(shown.final, cloth - trans[:, None], atol=1e-5)
    rows = read_metrics(made["metrics"])
    assert set(rows["garment"]) == {GARMENT}
    away = np.linalg.norm(shown.final[:, :, None] - sequence.points[:, None], axis=-1)
    found = find_value(rows, "ours", "scans", GARMENT, "to_cloud_mm")
    assert found.value == pytest.approx(1000 * away.min(axis=2).mean(), rel=1e-3)
    assert find_value(rows, "ours_proposals", "scans", GARMENT, "inside_share") is not None
    pictures = {"steps": tmp_path / "steps.png", "moving": tmp_path / "moving.png"}
    pictures["page"] = tmp_path / "page.html"
    run_rule("plot_reconstructed", input=[made["shown"]], output=pictures, params={"rays": 0.02})
    with Image.open(pictures["moving"]) as image:
        assert image.n_frames == len(cloth)
        assert image.info["duration"] == pytest.approx(1000 / 30, abs=1)
    assert "<html" in pictures["page"].read_text()


def test_of_twice_as_many_frames_a_second_half_are_reconstructed(reconstruct, worn):
    sequence, trans = worn
    made = reconstruct(sequence.points, fps=60)
    with Sample(made["sample"]) as sample:
        assert sample.frame_count == -(-len(trans) // 2)
        np.testing.assert_allclose(sample.info.trans, trans[::2])


@pytest.fixture
def blind(trained, tmp_path):
    """Our model whose network takes no point for the garment."""
    folder = tmp_path / "blind"
    shutil.copytree(trained("ours"), folder)
    guesser = OurModel(folder, "cpu").guesser
    guesser.labels.network.segmentation.head[-1].bias[guesser.label] = -1e6
    write_checkpoint(folder / BEST, guesser.state_dict(), read_checkpoint(folder / BEST).metadata)
    return folder


def test_scans_that_cannot_be_reconstructed_are_refused(reconstruct, worn, blind):
    sequence, _ = worn
    for points, fps, model, reason in (
        (sequence.points[:2], 30, None, "sequence to reconstruct has 2 frames, expected at lea"),
        (1000 * sequence.points, 30, None, "m large.*expected metres"),
        (sequence.points, 50, None, "50 frames per second, expected a multiple of 30"),
        (sequence.points, 30, blind, f"0.0% of the points are taken for {GARMENT}, expected 2% or"),
    ):
        with pytest.raises(SystemExit, match=reason):
            reconstruct(points, fps, model)
