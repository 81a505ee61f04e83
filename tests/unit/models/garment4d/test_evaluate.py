"""All variants, measured."""

import copy

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from drapeline.bodies.model import posed_vertices
from drapeline.errors import InputError
from drapeline.metrics.predictions import load_reconstruction
from drapeline.metrics.table import read_metrics, write_metrics
from drapeline.models.garment4d import evaluate as evaluation_module
from drapeline.models.garment4d import reconstruct as reconstruct_module
from drapeline.models.garment4d.evaluate import (
    BY_VERTEX,
    ONE,
    GuessedLabels,
    SplitEvaluation,
    evaluate,
)
from drapeline.models.garment4d.reconstruct import estimate, reconstruct
from drapeline.models.garment4d.settings import EvaluationSettings
from drapeline.registration.settings import RefineSettings
from drapeline.seeding import rng_for
from toys.garment4d import open_toy_data, save_toy_data
from toys.metric_rows import find_value

COUNTED = 10  # every so many frames of the training sequences
NOTHING_WORSE = dict.fromkeys(
    (
        *("neighbours", "missing", "accuracy", "body_noise_rad", "point_noise_m", "views"),
        "frame_rates",
    ),
    (),
)


@pytest.fixture
def quick(ours):
    """Our model, which lays garments on points in a few rounds."""
    ours.refining = RefineSettings(rounds=4)
    return ours


@pytest.fixture
def rows(sequences, canonical, identity, quick, tmp_path):
    settings = EvaluationSettings(
        neighbours=(1, 16),
        missing=(0.3,),
        accuracy=(1.0, 0.5),
        body_noise_rad=(0.2,),
        point_noise_m=(),
        views=(1,),
    )
    found = evaluate(
        sequences,
        {"canonical": canonical},
        {"posed": identity},
        quick,
        ("val", "test"),
        settings,
        pictures=tmp_path / "pictures",
        vertex_sampled=sequences,
    )
    write_metrics(tmp_path / "metrics.tsv", found)
    return read_metrics(tmp_path / "metrics.tsv")


def test_every_variant_is_measured_against_the_truth(rows, data, identity, held_out):
    def value(variant, metric, split="test"):
        return find_value(rows, variant, split, "Skirt", metric).value

    assert set(rows["garment"]) == {"Skirt"}
    sequence = int(data.of_split("test")[0])
    true = data.garment[data.rows(sequence)]
    mean = 1000 * np.linalg.norm(data.canonical[sequence] - data.space.mean, axis=-1).mean()
    assert value("mean_garment", "canonical_error_mm") == pytest.approx(mean, rel=1e-4)
    made = reconstruct(identity, held_out)
    error = 1000 * np.linalg.norm(made.final - true, axis=-1).mean()
    assert value("posed", "vertex_error_mm") == pytest.approx(error, rel=1e-4)
    assert value("lbs", "vertex_error_mm") == pytest.approx(error, rel=1e-4)
    assert value("neighbours_16", "vertex_error_mm") == pytest.approx(error, rel=1e-4)
    assert value("vertex_sampled", "vertex_error_mm") == pytest.approx(error, rel=1e-4)
    assert value("neighbours_1", "vertex_error_mm") != pytest.approx(error, rel=1e-4)
    assert value("posed_body_noise_200", "vertex_error_mm") > error
    for model, plain in (("posed", "posed"), ("lbs", "lbs"), ("ours", "ours")):
        assert value(f"{model}_undegraded", "vertex_error_mm") == pytest.approx(
            value(plain, "vertex_error_mm"), rel=1e-4
        )
        for worse in ("missing_30", "accuracy_100", "accuracy_50", "body_noise_200", "views_1"):
            assert value(f"{model}_{worse}", "vertex_error_mm") > 0
    # Displacements are zero, so that skinning alone is the full model.
    noisy = [value(f"{v}_body_noise_200", "vertex_error_mm") for v in ("posed", "lbs", "ours")]
    assert noisy[0] == noisy[1] != noisy[2]
    assert 0 <= value("one_label", "segmentation_accuracy") <= 1
    assert value("label_by_vertex", "segmentation_accuracy") > value(
        "one_label", "segmentation_accuracy"
    )
    # The truth is told apart from the body only; toy points are its own vertices.
    assert value("posed", "vertex_error_mm", "val") > 0
    assert find_value(rows, "untrained", "val", "Skirt", "vertex_error_mm") is None
    assert find_value(rows, "truth", "test", "Skirt", "vertex_error_mm") is None
    assert find_value(rows, "truth", "test", "Skirt", "canonical_error_mm") is None
    # Toy garments vary in width and length alone, and registration changes nothing of them.
    assert value("truth", "canonical_to_original_mm") == pytest.approx(0, abs=1e-3)
    assert value("pca", "canonical_error_mm") < 0.1 * value("canonical", "canonical_error_mm")
    assert value("truth", "to_cloud_mm") < value("posed", "to_cloud_mm")
    # Simulated sequences alone are measured, though the split has another one.
    assert find_value(rows, "posed", "val", "Skirt", "vertex_error_mm").n == 1
    assert find_value(rows, "canonical", "val", "Skirt", "canonical_error_mm").n == 1
    assert not [
        row for row in rows.itertuples() if row.split == "val" and "undegraded" in row.variant
    ]


def test_our_model_is_measured_step_by_step_and_given_parts_of_the_truth(
    rows, sequences, data, quick, held_out
):
    sequence = int(data.of_split("test")[0])
    true, labels = data.garment[data.rows(sequence)], data.labels[data.rows(sequence)]
    guess, made = quick.guesser.guess(held_out), quick.make(held_out)
    told = quick.make(held_out._replace(labels=labels))
    seen = held_out._replace(labels=made.labels)
    rest = quick.final_step.lay(data.canonical[sequence], seen, quick.refining)

    def error_mm(garment, of):
        return pytest.approx(1000 * np.linalg.norm(garment - of, axis=-1).mean(), rel=1e-4)

    def value(variant, metric):
        return find_value(rows, variant, "test", "Skirt", metric).value

    for variant, garment in (
        ("regression", guess.canonical),
        ("ours", made.canonical),
        ("ours_true_labels", told.canonical),
    ):
        assert value(variant, "canonical_error_mm") == error_mm(garment, data.canonical[sequence])
    for variant, garment in (
        ("ours_proposals", made.proposal),
        ("ours", made.final),
        ("ours_true_labels", told.final),
        ("ours_true_rest", rest.final),
    ):
        assert value(variant, "vertex_error_mm") == error_mm(garment, true)
    right = (made.labels == labels).mean()
    assert value("ours", "segmentation_accuracy") == pytest.approx(right)
    assert value("ours", "inference_s_per_frame") > 0
    # The truth is a matter of the test split.
    assert find_value(rows, "ours", "val", "Skirt", "vertex_error_mm").n == 1
    assert find_value(rows, "ours_true_labels", "val", "Skirt", "vertex_error_mm") is None


def test_the_untrained_canonical_stage_is_measured_as_its_training_began(
    sequences, canonical, identity, quick, data, held_out, tmp_path
):
    trained = copy.deepcopy(canonical)
    with torch.no_grad():
        trained.network.encoder.coefficients.bias.add_(1)
    found = evaluate(
        sequences,
        {"canonical": trained},
        {"posed": identity},
        quick,
        ("test",),
        EvaluationSettings(**NOTHING_WORSE),
        pictures=tmp_path / "pictures",
    )
    true = data.canonical[int(data.of_split("test")[0])]
    errors = {}
    for variant, stage in (("canonical", trained), ("canonical_untrained", canonical)):
        made = estimate(stage, held_out.points)
        errors[variant] = 1000 * np.linalg.norm(made.canonical - true, axis=-1).mean()
        measured = find_value(found, variant, "test", "Skirt", "canonical_error_mm").value
        assert measured == pytest.approx(errors[variant], rel=1e-4)
    assert errors["canonical"] != pytest.approx(errors["canonical_untrained"], rel=1e-4)


def test_garments_moved_by_skinning_are_never_measured(toy_body, tmp_path):
    save_toy_data(tmp_path / "data", toy_body)
    sequences = open_toy_data(tmp_path / "data", toy_body, 30)
    data = sequences.data
    data.split[(data.source == "blender") & (data.split == "val")] = "train"
    assert len(data.of_split("val"))
    with pytest.raises(InputError, match="no Skirt of the val split is simulated"):
        SplitEvaluation(sequences, "val", EvaluationSettings())


@pytest.mark.parametrize("worse", [{}, {"body_noise_rad": (0.05,)}, {"point_noise_m": (0.01,)}])
def test_inputs_that_are_not_worse_are_not_measured_twice(
    sequences, canonical, identity, quick, tmp_path, worse
):
    found = evaluate(
        sequences,
        {"canonical": canonical},
        {"posed": identity},
        quick,
        ("test",),
        EvaluationSettings(**{**NOTHING_WORSE, **worse}),
        pictures=tmp_path / "pictures",
    )
    names = {"body_noise_rad": "body_noise_50", "point_noise_m": "point_noise_10"}
    cases = {"undegraded", *(names[key] for key in worse)} if worse else set()
    variants = {row.variant for row in found.itertuples()}
    expected = {f"{model}_{case}" for model in ("posed", "lbs", "ours") for case in cases}
    assert variants & {v for v in variants if "noise" in v or "undegraded" in v} == expected


def test_a_body_that_is_off_reaches_our_garment_at_rest(sequences, quick, identity):
    settings = EvaluationSettings(**{**NOTHING_WORSE, "body_noise_rad": (0.2,)})
    evaluation = SplitEvaluation(sequences, "test", settings)
    evaluation.measure_degraded({"posed": identity}, quick)
    rows = evaluation.rows()
    for metric in ("canonical_error_mm", "vertex_error_mm"):
        plain, noisy = (
            find_value(rows, f"ours_{case}", "test", "Skirt", metric).value
            for case in ("undegraded", "body_noise_200")
        )
        assert plain != noisy
    # The paper's canonical networks never look at the body.
    for case in ("undegraded", "body_noise_200"):
        assert find_value(rows, f"posed_{case}", "test", "Skirt", "canonical_error_mm") is None


@pytest.fixture
def asked(monkeypatch):
    """Points, and labels if any, that a canonical network is asked about."""
    found = []

    def noted(stage, points, **options):
        found.append((points, options.get("labels")))
        return estimate(stage, points, **options)

    for module in (evaluation_module, reconstruct_module):
        monkeypatch.setattr(module, "estimate", noted)
    return found


def test_networks_are_asked_about_what_is_worse(sequences, identity, quick, held_out, data, asked):
    settings = EvaluationSettings(**{**NOTHING_WORSE, "missing": (0.3,), "accuracy": (0.5,)})
    SplitEvaluation(sequences, "test", settings).measure_degraded({"posed": identity}, quick)
    plain, holed, told = asked
    for points, _ in (plain, told):
        np.testing.assert_array_equal(points, held_out.points)
    left = (holed[0][:, :, None] == held_out.points[:, None]).all(-1).any(1)  # (F, P)
    assert 0.3 < left.mean() < 0.95
    assert plain[1] is holed[1] is None
    true = data.labels[data.rows(int(data.of_split("test")[0]))]
    assert (told[1] == true).mean() == pytest.approx(0.5, abs=0.1)


def test_stages_share_what_one_canonical_network_says_whatever_the_body(
    sequences, identity, quick, asked
):
    other = copy.deepcopy(identity)
    with torch.no_grad():
        next(other.canonical.network.parameters()).mul_(2)
    settings = EvaluationSettings(**{**NOTHING_WORSE, "body_noise_rad": (0.05,)})
    evaluation = SplitEvaluation(sequences, "test", settings)
    count = len(evaluation.simulated)
    for stage, expected in ((identity, 1), (copy.deepcopy(identity), 1), (other, 2)):
        for sequence in evaluation.simulated:
            evaluation.measure_posed("posed", stage, sequence)
        assert len(asked) == expected * count
    evaluation.measure_degraded({"posed": identity, "mgn": other}, quick)
    assert len(asked) == 2 * count


def test_pictures_hold_all_stages(rows, data, held_out, identity, quick, tmp_path):
    name = str(data.name[data.of_split("test")[0]])
    files = sorted(path.name for path in (tmp_path / "pictures").iterdir())
    assert files == [f"{name}.npz", f"{name}_ours.npz"]
    shown, ours = (load_reconstruction(tmp_path / "pictures" / file) for file in files)
    for found, made in ((shown, reconstruct(identity, held_out)), (ours, quick.make(held_out))):
        for key in ("labels", "canonical", "proposal", "final"):
            np.testing.assert_allclose(getattr(found, key), getattr(made, key), atol=1e-6)
    assert shown.garment == ours.garment == "Skirt"
    assert np.abs(ours.final - shown.final).max() > 1e-3
    assert (shown.body[..., 2].min(axis=1) + shown.root_height == 0).all()


@pytest.fixture
def beneath(sequences):
    """Lays all points .1 mm above vertices of the body that have none within 2 mm.

    Sequence -> (F, P) these vertices.
    """
    data = sequences.data
    data.points, data.labels = np.array(data.points), np.array(data.labels)
    posed = {}
    for sequence in range(len(data)):
        body, poses = sequences.body(sequence), data.poses[data.rows(sequence)]
        posed[sequence] = posed_vertices(body.model, body.shape, poses)[0]
    gaps = [
        cKDTree(frame).query(frame, 2)[0][:, 1] for frames in posed.values() for frame in frames
    ]
    apart = np.flatnonzero(np.min(gaps, axis=0) > 0.002)
    vertices = {}
    for sequence, frames in posed.items():
        rng = rng_for(sequence, "points above vertices")
        size = len(frames), data.points.shape[1]
        vertices[sequence] = rng.choice(apart, size)
        at = np.take_along_axis(frames, vertices[sequence][..., None], axis=1)
        data.points[data.rows(sequence)] = at + [0, 0, 1e-4]
    return vertices


def test_labels_are_guessed_by_the_vertex_beneath_a_point(sequences, beneath):
    data = sequences.data
    train, test = (data.of_split(split).tolist() for split in ("train", "test"))
    for sequence, vertices in beneath.items():
        data.labels[data.rows(sequence)] = np.where(vertices % 4, 2, 5)
    seen = np.unique(np.concatenate([beneath[s][::COUNTED].ravel() for s in train]))
    for sequence in test:
        guessed = GuessedLabels(sequences).of(sequence)
        assert (guessed[ONE] == 2).all()
        known = np.isin(beneath[sequence], seen)
        assert known.any()
        assert not known.all()
        true = data.labels[data.rows(sequence)]
        np.testing.assert_array_equal(guessed[BY_VERTEX], np.where(known, true, 2))


def test_the_label_of_most_points_at_a_vertex_counts(sequences, beneath):
    data, votes = sequences.data, {}
    for sequence in data.of_split("train").tolist():
        labels = data.labels[data.rows(sequence)]
        labels[:] = rng_for(sequence, "labels").integers(3, size=labels.shape)
        pairs = zip(beneath[sequence][::COUNTED].ravel(), labels[::COUNTED].ravel(), strict=True)
        for vertex, label in pairs:
            votes.setdefault(vertex, np.zeros(3, dtype=int))[label] += 1
    assert any((count > 0).sum() > 1 for count in votes.values())
    one = sum(votes.values()).argmax()
    (sequence,) = data.of_split("test").tolist()[:1]
    expected = [
        [votes[v].argmax() if v in votes else one for v in frame] for frame in beneath[sequence]
    ]
    found = GuessedLabels(sequences).of(sequence)
    np.testing.assert_array_equal(found[BY_VERTEX], expected)
    assert (found[ONE] == one).all()
