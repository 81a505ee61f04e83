"""Scans of simulated samples with the bodies that fit them."""

import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices
from drapeline.bodies.moved_body import BodyState
from drapeline.bodies.settings import BodyFit
from drapeline.dataset import scan_bodies
from drapeline.dataset.reader import Sample
from drapeline.dataset.scan_bodies import fit_window_body, scan_samples
from drapeline.dataset.segmented_scans import load_scans, scan_sample
from drapeline.dataset.settings import ScanSettings
from toys.tiny_sample import write_tiny_sample


def test_accepted_samples_are_scanned_and_rejected_ones_are_not(tmp_path, toy_body):
    samples = [
        write_tiny_sample(tmp_path / name, toy_body, name, status=status).folder
        for name, status in (("00001", "rejected"), ("00002", "accepted"), ("00003", "accepted"))
    ]
    scan_samples(
        tmp_path / "scans.npz",
        samples,
        {"female": toy_body, "male": toy_body},
        settings=ScanSettings(frames=1, points=300),
        fit=BodyFit(steps=1, joint_steps=1, points=100),
        seed=0,
    )
    scans = load_scans(tmp_path / "scans.npz")
    assert [scan.name.split("_")[0] for scan, _ in scans] == ["00002", "00003"]


def scanned(folder, body, **settings):
    """Scans of a sample with their bodies, read from their file."""
    sample = write_tiny_sample(folder, body).folder
    scan_samples(
        folder / "scans.npz",
        [sample],
        {"female": body, "male": body},
        settings=ScanSettings(points=300, **settings),
        fit=BodyFit(steps=1, joint_steps=1, points=100),
        seed=0,
    )
    return load_scans(folder / "scans.npz")


@pytest.mark.parametrize("window", [1, 3])
def test_a_body_that_is_known_is_not_fitted(tmp_path, toy_body, monkeypatch, window):
    for fit in ("fit_scan_body", "fit_window_body"):
        monkeypatch.setattr(scan_bodies, fit, None)
    exact = dict.fromkeys(("noise_m", "pose_rad", "place_m", "joints_m", "shape"), 0)
    ((scan, body),) = scanned(tmp_path, toy_body, window=window, **exact)
    for part, estimated in zip(body, scan.estimate, strict=True):
        np.testing.assert_array_equal(part, estimated)


@pytest.mark.portable
def test_a_window_is_kept_with_the_body_that_was_fitted_to_all_of_it(tmp_path, toy_body):
    ((scan, body),) = scanned(tmp_path, toy_body, window=5)
    assert len(scan.window.points) == 5
    middle = BodyState.of(scan.window.poses[2], body.trans, body.shape)
    np.testing.assert_allclose(middle.rotations, body.rotations, atol=1e-6)
    # Both are relative to the root joint, one as it is and one as it was fitted.
    away = scan.window.points[2] + body.trans - scan.points
    np.testing.assert_allclose(away, 0, atol=1e-5)


@pytest.mark.portable
@pytest.mark.parametrize("seed", [0, 1])
def test_a_body_that_is_turned_alike_in_all_frames_is_found(tmp_path, toy_body, seed):
    settings = ScanSettings(
        window=5, points=1500, noise_m=0, pose_rad=0.05, place_m=0.02, shape=0.5
    )
    with Sample(write_tiny_sample(tmp_path, toy_body).folder) as sample:
        (scan,) = scan_sample(sample, toy_body, settings, seed)
        true = BodyState.of(sample.info.poses[scan.frame], np.zeros(3), sample.info.shape)
    _, found = fit_window_body(scan, toy_body, seed)

    def error(state):
        one, other = (
            posed_vertices(toy_body, body.shape, body.pose[None], body.trans[None])[0][0]
            for body in (state, true)
        )
        return np.linalg.norm(one - other, axis=1).mean()

    assert error(found) < 0.25 * error(scan.estimate)
