"""Measures of registered garments at rest and in motion."""

from types import SimpleNamespace

import numpy as np
import pytest

from drapeline.bodies.kinematics import skin_points
from drapeline.bodies.rest_body import rest_body, rest_to_pose
from drapeline.metrics.baselines import fit_pca, static_baseline_summary
from drapeline.metrics.registered import (
    Truth,
    add_kl,
    measure_motion,
    measure_predictions,
    measure_truth,
    measured_at_rest,
    measured_in_motion,
)
from drapeline.metrics.table import ALL, LOW, summarise
from drapeline.seeding import rng_for
from toys.gcvae_files import torso_registration
from toys.metric_rows import find_value
from toys.moving import moving_garment

ROWS = 12


@pytest.fixture(scope="module")
def truth(toy_body):
    """Shirts two centimetres over the torsos of bodies of several shapes."""
    shapes = rng_for(0, "metrics", "shapes").uniform(-1, 1, (ROWS, 10))
    registered = [torso_registration(toy_body, shape) for shape in shapes]
    return Truth(
        offsets=np.stack([one.offsets for one in registered]),
        mask=np.stack([one.mask for one in registered]),
        body=lambda row: rest_body(toy_body, shapes[row]),
        faces=lambda row: toy_body.faces,
        body_faces=toy_body.faces,
    )


@pytest.fixture
def garments(truth):
    """Three garments to an outfit; the last two outfits are for testing."""
    outfit = np.repeat([*"abcd"], 3)
    split = np.where(outfit < "c", "train", "test")
    return SimpleNamespace(
        offsets=truth.offsets,
        mask=truth.mask,
        garment=np.zeros(ROWS, dtype=int),
        outfit=outfit,
        rows=lambda wanted: np.flatnonzero(split == wanted),
        cvar=lambda rows: np.arange(ROWS)[rows, None].astype(np.float32),
    )


def test_offsets_are_measured_on_their_body(truth):
    shift = np.array([0.003, 0, 0.004])
    rows = measure_predictions(
        truth, [(row, (truth.offsets[row] + shift, truth.mask[row])) for row in (0, 5)]
    )
    for row in rows:
        assert row["surface_error_mm"] == pytest.approx(5, rel=1e-4)
        assert row["normal_error_deg"] == pytest.approx(0, abs=0.1)
        assert row["mask_iou"] == 1
        assert row["inside_1cm_share"] == 0


def test_the_truth_itself_is_outside_of_the_body_and_skin_is_not(truth):
    (true,) = measure_truth(truth, [3])
    assert true["inside_share"] == 0
    sunk = truth.mask[3][:, None] * (truth.body(3) * [0.7, 0.7, 1] - truth.body(3))
    (row,) = measure_predictions(truth, [(3, (sunk, None))])
    assert row["inside_1cm_share"] > 0.8
    assert "mask_iou" not in row  # of a model without a mask
    assert row["pieces"] == true["pieces"]  # judged within the true one


def test_kl_stands_beside_its_garment():
    rows = add_kl([{"mask_iou": 0.5}, {"mask_iou": 1.0}], np.array([3.0, 4.0]))
    assert rows == [{"mask_iou": 0.5, "kl_nat": 3.0}, {"mask_iou": 1.0, "kl_nat": 4.0}]
    with pytest.raises(ValueError, match="zip"):
        add_kl([{"mask_iou": 0.5}], np.array([3.0, 4.0]))


def test_garments_of_one_outfit_are_dependent(garments):
    measured = measured_at_rest(garments, np.arange(2, 5), [{"mask_iou": k} for k in range(3)])
    assert [one.group for one in measured] == ["a", "b", "b"]
    assert [one.measures["mask_iou"] for one in measured] == [0, 1, 2]
    assert {one.garment for one in measured} == {"Tshirt"}


def test_baselines_are_learned_from_the_training_split_and_measured_on_others(truth, garments):
    pca = fit_pca(truth.offsets[:6], truth.mask[:6], components=8)
    splits = {"test": garments.rows("test")}
    rows = static_baseline_summary(truth, garments, splits, pca, seed=0)
    assert set(rows["split"]) == {"test"}
    assert set(rows["variant"]) == {"registered", "mean_garment", "nearest_cvar", "pca"}
    error = {
        name: find_value(rows, name, "test", ALL, "surface_error_mm")
        for name in ("registered", "mean_garment", "pca")
    }
    assert error["registered"] is None  # nothing to compare with
    assert error["mean_garment"].n == 6
    mean = truth.offsets[:6].mean(0)
    by_hand = [
        1000 * np.linalg.norm(mean - truth.offsets[row], axis=1)[truth.mask[row]].mean()
        for row in range(6, ROWS)
    ]
    assert error["mean_garment"].value == pytest.approx(np.mean(by_hand), rel=1e-3)
    assert error["pca"].value < error["mean_garment"].value


@pytest.fixture(scope="module")
def topology(toy_body):
    return SimpleNamespace(faces=toy_body.faces, faces_of=lambda name: toy_body.faces)


def test_a_perfect_prediction_has_no_error_and_is_outside(toy_body, topology):
    moving = moving_garment(toy_body, "test", "Tshirt")
    frames = np.array([1, 4])
    rows = measure_motion(moving, frames, moving.points(frames), toy_body, topology)
    assert [row["surface_error_mm"] for row in rows] == [0, 0]
    assert rows[0]["inside_1cm_share"] == 0
    assert "inside_share" not in rows[1]  # only every fifth frame


def test_cloth_inside_the_body_is_seen_in_its_pose(toy_body, topology):
    moving = moving_garment(toy_body, "test", "Tshirt")
    frames = np.array([3])
    body = rest_body(toy_body, moving.shape)[moving.registered.vertex]
    inside = skin_points(
        body * [0.7, 0.7, 1],
        rest_to_pose(toy_body, moving.shape, moving.poses[frames]),
        moving.registered.weights,
    )
    (row,) = measure_motion(moving, frames, inside, toy_body, topology)
    assert row["inside_1cm_share"] > 0.8
    assert row["surface_error_mm"] > 20


def test_frames_of_one_clip_are_dependent(toy_body):
    moving = moving_garment(toy_body, "test", "Tshirt", clip="walk")
    measured = measured_in_motion(moving, [{"surface_error_mm": 1.0}, {"surface_error_mm": 2.0}])
    assert [one.group for one in measured] == ["walk"] * 2
    assert [one.measures["surface_error_mm"] for one in measured] == [1.0, 2.0]
    assert {(one.garment, one.source) for one in measured} == {("Tshirt", moving.source)}


def test_samples_of_one_clip_are_no_more_evidence_than_the_clip(toy_body):
    """Four samples of two clips have no interval; of three clips, they have one."""

    def summary(*clips):
        measured = [
            one
            for seed, clip in enumerate(clips)
            for one in measured_in_motion(
                moving_garment(toy_body, "test", "Tshirt", seed=seed, clip=clip),
                [{"surface_error_mm": seed + 1.0}],
            )
        ]
        return summarise(measured, model="dvae", variant="a", split="test", seed=0)

    low = "surface_error_mm" + LOW
    assert find_value(summary("walk", "walk", "run", "run"), "a", "test", ALL, low) is None
    assert find_value(summary("walk", "walk", "run", "jump"), "a", "test", ALL, low) is not None
