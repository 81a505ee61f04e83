"""Mean and ridge regression per cluster, against displacements that are known."""

import numpy as np
import pytest

from drapeline.frames import REST_POSE
from drapeline.learning_data.pose_displacements import DisplacementData, encode_poses
from drapeline.models.smplicit.displacement_baselines import PENALTIES, ClusterDisplacement
from toys.displacement import ALWAYS_M, CLUSTERS, SLOPE_M
from toys.smplicit import toy_bodies


@pytest.fixture(scope="module")
def baselines(displacements, toy_body):
    return ClusterDisplacement(displacements, toy_bodies(toy_body), CLUSTERS)


def test_the_mean_is_that_of_the_training_frames(baselines, displacements, moving_skirts):
    test = moving_skirts[3]
    found = baselines.displacements(test.meshes["Skirt"], test.shape, 0, None)
    assert found.shape == (1, len(test.meshes["Skirt"].vertices), 3)
    pose = displacements.pose[displacements.rows("train")]
    expected = ALWAYS_M + pose[:, 1:2].mean(axis=0) * SLOPE_M
    assert found[0] == pytest.approx(np.broadcast_to(expected, found[0].shape), abs=1e-4)


def test_ridge_regression_is_the_slow_ones(baselines, displacements, moving_skirts):
    """All clusters are displaced alike here, so one regression tells them all."""
    rows = displacements.rows("train")
    pose = displacements.pose[rows].astype(float)
    away = np.stack([displacements.displacements(row).mean(axis=0) for row in rows])
    centred = pose - pose.mean(axis=0)
    strength = baselines.penalty * np.trace(centred.T @ centred) / pose.shape[1]
    stacked = np.vstack([centred, np.sqrt(strength) * np.eye(pose.shape[1])])
    slope, *_ = np.linalg.lstsq(
        stacked, np.vstack([away - away.mean(axis=0), np.zeros((pose.shape[1], 3))]), rcond=None
    )
    test = moving_skirts[3]
    found = baselines.displacements(test.meshes["Skirt"], test.shape, 0, test.poses)
    expected = away.mean(axis=0) + (encode_poses(test.poses) - pose.mean(axis=0)) @ slope
    assert found == pytest.approx(np.broadcast_to(expected[:, None], found.shape), abs=1e-4)


def test_the_penalty_is_the_best_on_validation_frames(baselines, displacements, moving_skirts):
    assert baselines.penalty in PENALTIES
    errors = {}
    for penalty in PENALTIES:
        cluster = baselines._known[0]
        slope, mean = baselines._slopes(penalty)[:, cluster], baselines._mean[cluster]
        rows = displacements.rows("val")
        predicted = mean + (displacements.pose[rows] - baselines._sums.pose) @ slope
        away = np.stack([displacements.displacements(row).mean(axis=0) for row in rows])
        errors[penalty] = np.linalg.norm(predicted - away, axis=1).mean()
    assert baselines.penalty == min(errors, key=errors.get)


def test_only_clusters_near_cloth_are_known(baselines, displacements):
    assert 0 < len(baselines._known) < len(CLUSTERS)
    near = set()
    for garment, split in enumerate(displacements.split):
        if split == "train":
            places = baselines._places(displacements.shape[garment], 0)
            points = displacements.garment_points(garment)
            near |= {int(np.linalg.norm(places - point, axis=1).argmin()) for point in points}
    assert near == {*baselines._known.tolist()}


def test_the_pose_of_rest_is_a_pose_like_others(baselines, moving_skirts):
    test = moving_skirts[3]
    given = (test.meshes["Skirt"], test.shape, 0)
    poses = np.stack([REST_POSE, test.poses[0]])
    both = baselines.displacements(*given, poses)
    assert both[0] == pytest.approx(baselines.displacements(*given, REST_POSE[None])[0])
    assert np.abs(both[1] - both[0]).max() > 1e-4


def test_a_single_pose_teaches_nothing_about_poses(displacements, toy_body, moving_skirts):
    still = DisplacementData(displacements.folder)
    still.pose = np.zeros_like(still.pose)
    baselines = ClusterDisplacement(still, toy_bodies(toy_body), CLUSTERS)
    test = moving_skirts[3]
    given = (test.meshes["Skirt"], test.shape, 0)
    posed = baselines.displacements(*given, test.poses)
    assert posed == pytest.approx(np.repeat(baselines.displacements(*given, None), len(posed), 0))


def test_frames_without_cloth_at_a_cluster_do_not_count(displacements, toy_body, monkeypatch):
    """The second garment is taken to be far below the first."""
    points, below = DisplacementData.garment_points, np.array([0, 0, -0.5])
    monkeypatch.setattr(
        DisplacementData, "garment_points", lambda self, g: points(self, g) + (g == 1) * below
    )
    baselines = ClusterDisplacement(displacements, toy_bodies(toy_body), CLUSTERS)
    (cluster, *_) = {*baselines._near[0].tolist()} - {*baselines._near[1].tolist()}
    rows = displacements.rows("train")
    first = displacements.garment_index[rows] == 0
    pose = displacements.pose[rows].astype(float)
    pose -= pose.mean(axis=0)
    away = np.stack([displacements.displacements(row).mean(axis=0) for row in rows[first]])
    strength = 0.1 * np.trace(pose.T @ pose) / pose.shape[1]
    system = pose.T @ pose + strength * np.eye(pose.shape[1])
    expected = np.linalg.solve(system, pose[first].T @ (away - away.mean(axis=0)))
    assert baselines._slopes(0.1)[:, cluster] == pytest.approx(expected, abs=1e-4)
