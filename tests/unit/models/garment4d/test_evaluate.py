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
from drapeline.models.garment4d.evaluate import (
    BY_VERTEX,
    ONE,
    GuessedLabels,
    SplitEvaluation,
    evaluate,
)
from drapeline.models.garment4d.final_step import fit_final_step
from drapeline.models.garment4d.reconstruct import estimate, reconstruct
from drapeline.models.garment4d.settings import EvaluationSettings
from drapeline.registration.settings import RefineSettings
from drapeline.seeding import rng_for
from toys.garment4d import CANONICAL, fill_regression, open_toy_data, save_toy_data
from toys.garment4d_stages import build_canonical
from toys.metric_rows import find_value

COUNTED = 10  # every so many frames of the training sequences


@pytest.fixture
def rows(sequences, canonical, identity, tmp_path):
    settings = EvaluationSettings(
        neighbours=(1, 16), missing=(0.3,), accuracy=(1.0, 0.5), noise_shape=2.0
    )
    found = evaluate(
        sequences,
        {"canonical": canonical},
        {"posed": identity},
        ("val", "test"),
        settings,
        RefineSettings(rounds=4),
        fit_final_step(sequences, identity.settings.skinning, [], RefineSettings(), "skinned"),
        pictures=tmp_path / "pictures",
        vertex_sampled=sequences,
    )
    write_metrics(tmp_path / "metrics.tsv", found)
    return read_metrics(tmp_path / "metrics.tsv")


def test_every_variant_is_measured_against_the_truth(rows, data, identity, given, tmp_path):
    def value(variant, metric, split="test"):
        return find_value(rows, variant, split, "Skirt", metric).value

    assert set(rows["garment"]) == {"Skirt"}
    sequence = int(data.of_split("test")[0])
    true = data.garment[data.rows(sequence)]
    mean = 1000 * np.linalg.norm(data.canonical[sequence] - data.space.mean, axis=-1).mean()
    assert value("mean_garment", "canonical_error_mm") == pytest.approx(mean, rel=1e-4)
    made = reconstruct(identity, **given)
    error = 1000 * np.linalg.norm(made.final - true, axis=-1).mean()
    assert value("posed", "vertex_error_mm") == pytest.approx(error, rel=1e-4)
    assert value("lbs", "vertex_error_mm") == pytest.approx(error, rel=1e-4)
    assert value("neighbours_16", "vertex_error_mm") == pytest.approx(error, rel=1e-4)
    assert value("vertex_sampled", "vertex_error_mm") == pytest.approx(error, rel=1e-4)
    assert value("neighbours_1", "vertex_error_mm") != pytest.approx(error, rel=1e-4)
    assert value("noisy_body", "vertex_error_mm") > error
    # Displacements are zero, so that skinning alone is the full model.
    noisy = [value(f"{v}noisy_body", "vertex_error_mm") for v in ("", "lbs_", "ours_")]
    assert noisy[0] == noisy[1] != noisy[2]
    labels = {variant for variant in rows["variant"]}
    assert {"missing_30", "accuracy_100", "accuracy_50", "truth", "canonical", "ours"} <= labels
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
        row for row in rows.itertuples() if row.split == "val" and row.variant == "noisy_body"
    ]


def test_garments_moved_by_skinning_are_never_measured(toy_body, tmp_path):
    save_toy_data(tmp_path / "data", toy_body)
    sequences = open_toy_data(tmp_path / "data", toy_body, 30)
    data = sequences.data
    data.split[(data.source == "blender") & (data.split == "val")] = "train"
    assert len(data.of_split("val"))
    with pytest.raises(InputError, match="no Skirt of the val split is simulated"):
        SplitEvaluation(sequences, "val", EvaluationSettings())


def test_bodies_without_noise_are_not_measured_twice(sequences, canonical, identity, tmp_path):
    settings = EvaluationSettings(neighbours=(), missing=(), accuracy=(), noise_pose_rad=0)
    found = []
    for noise_shape in (0.0, 1.0):
        rows = evaluate(
            sequences,
            {"canonical": canonical},
            {"posed": identity},
            ("test",),
            settings.replace(noise_shape=noise_shape),
            RefineSettings(rounds=1),
            None,
            pictures=tmp_path / "pictures",
        )
        found.append({row.variant for row in rows.itertuples() if "noisy" in row.variant})
    assert found == [set(), {"noisy_body", "lbs_noisy_body", "ours_noisy_body"}]


def test_a_noisy_body_reaches_canonical_stages_with_body_relative_points(sequences, identity):
    relative = build_canonical(sequences, CANONICAL).eval()
    fill_regression(relative.network.regression)
    evaluation = SplitEvaluation(sequences, "test", EvaluationSettings(), RefineSettings(rounds=1))
    stages = {"canonical": relative, "pointnet": identity.canonical}
    evaluation.measure_canonicals(stages)
    evaluation.measure_noisy_bodies(stages, {"posed": identity})
    rows = evaluation.rows()
    assert not [row for row in rows.itertuples() if row.variant == "pointnet_noisy_body"]
    plain, noisy = (
        find_value(rows, variant, "test", "Skirt", "canonical_error_mm").value
        for variant in ("canonical", "canonical_noisy_body")
    )
    assert plain != noisy


def test_stages_share_what_one_canonical_network_says_of_one_body(sequences, identity, monkeypatch):
    asked = []

    def counted(*args, **options):
        asked.append(options)
        return estimate(*args, **options)

    monkeypatch.setattr(evaluation_module, "estimate", counted)
    other = copy.deepcopy(identity)
    with torch.no_grad():
        next(other.canonical.network.parameters()).mul_(2)
    evaluation = SplitEvaluation(sequences, "test", EvaluationSettings(), RefineSettings(rounds=1))
    count = len(evaluation.simulated)
    for stage, expected in ((identity, 1), (copy.deepcopy(identity), 1), (other, 2)):
        for sequence in evaluation.simulated:
            evaluation.measure_posed("posed", stage, sequence)
        assert len(asked) == expected * count
    evaluation.measure_noisy_bodies({}, {"posed": identity})
    assert len(asked) == 3 * count


def test_pictures_hold_all_stages(rows, data, given, identity, tmp_path):
    name = str(data.name[data.of_split("test")[0]])
    files = sorted(path.name for path in (tmp_path / "pictures").iterdir())
    assert files == [f"{name}.npz", f"{name}_ours.npz"]
    shown, ours = (load_reconstruction(tmp_path / "pictures" / file) for file in files)
    made = reconstruct(identity, **given)
    for key in ("canonical", "proposal", "final"):
        np.testing.assert_allclose(getattr(shown, key), getattr(made, key), atol=1e-6)
    assert shown.garment == "Skirt"
    assert ours.final.shape == shown.true.shape
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
