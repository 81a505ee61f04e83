"""Components fitted to the points of tubes, and the networks' garments in a scan."""

from dataclasses import replace

import numpy as np
import pytest

from drapeline.bodies.moved_body import BodyState
from drapeline.bodies.rest_body import rest_body
from drapeline.dataset.segmented_scans import ScanWindow, SegmentedScan
from drapeline.frames import REST_POSE
from drapeline.geometry.closest import closest_points
from drapeline.models.garment4d.ours.model import Guesser
from drapeline.models.garment4d.reconstruct import NetworksModel
from drapeline.models.garment4d.scans import (
    MOVED,
    OURS,
    PCA,
    POSED,
    FitTemplate,
    Garment4dScanFitter,
    fit_template,
)
from drapeline.outfits.garment_types import LABELS
from drapeline.registration.to_template.garment_space import fit_space
from toys.garment4d import GARMENT, skirt_faces, toy_sequences
from toys.tiny_sample import tube

STATE = BodyState.of(REST_POSE, np.array([0.1, -0.2, 1.0]), np.zeros(10))


def skirt(radius, bottom):
    return tube(radius, bottom, 0.05, 12, 5).vertices.astype(np.float64)


def space():
    """Skirts of all widths and lengths."""
    rng = np.random.default_rng(0)
    sizes = zip(rng.uniform(0.2, 0.3, 30), rng.uniform(-0.6, -0.3, 30), strict=True)
    return fit_space(np.stack([skirt(*size) for size in sizes]), 2, skirt_faces())


def scan(body, garments=("Skirt",), **clouds):
    """Clouds at rest, moved to where the body stands, with skin."""
    clouds = {"Body": rest_body(body, STATE.shape), **clouds}
    labels = np.repeat([LABELS.index(name) for name in clouds], [len(c) for c in clouds.values()])
    points = np.concatenate([*clouds.values()]) + STATE.trans
    return SegmentedScan(
        "s",
        0,
        points.astype(np.float32),
        labels.astype(np.uint8),
        garments,
        "female",
        STATE,
        None,
    )


def on_faces(vertices, count=3000):
    rng = np.random.default_rng(1)
    corners = vertices[skirt_faces()[rng.integers(len(skirt_faces()), size=count)]]
    return (corners * rng.dirichlet(np.ones(3), (count, 1)).swapaxes(1, 2)).sum(axis=1)


def fit(body, shown):
    rng = np.random.default_rng(2)
    return fit_template(space(), shown, "Skirt", body, STATE, FitTemplate(points=800), rng)


@pytest.mark.portable
@pytest.mark.parametrize("size", [(0.22, -0.55), (0.29, -0.35)])
def test_components_find_the_width_and_the_length_of_a_skirt(toy_body, size):
    true = skirt(*size)
    found = fit(toy_body, scan(toy_body, Skirt=on_faces(true)))
    assert np.linalg.norm(found - true, axis=1).mean() < 0.006


@pytest.mark.portable
def test_what_an_outer_garment_hides_is_not_cut_off(toy_body):
    """The upper half is hidden by a top; only the lower one has points."""
    true = skirt(0.25, -0.5)
    seen = on_faces(true)
    shown = seen[seen[:, 2] < -0.2]
    cover = on_faces(true * [1.1, 1.1, 1])
    cover = cover[cover[:, 2] > -0.2]
    found = fit(toy_body, scan(toy_body, ("Skirt", "Top"), Skirt=shown, Top=cover))
    place, _ = closest_points(true, found, skirt_faces())
    assert np.linalg.norm(place - true, axis=1).mean() < 0.012


@pytest.fixture
def fitter(ours, trained_posed):
    networks = {GARMENT: NetworksModel(trained_posed, "cpu")}
    return Garment4dScanFitter({GARMENT: ours}, networks, FitTemplate(points=200, steps=2), 0)


@pytest.fixture
def shown(toy_body):
    return scan(toy_body, ("Skirt", "Top"), Skirt=on_faces(skirt(0.25, -0.5), 400))


def test_components_networks_and_our_model_give_posed_garments(fitter, shown, toy_body):
    found = fitter.fit(shown, STATE)
    assert set(found) == {PCA, MOVED, POSED, OURS} == set(fitter.watch.seconds)
    for garments in found.values():
        assert set(garments) == {GARMENT}
        mesh = garments[GARMENT]
        assert np.isfinite(mesh.vertices).all()
        # Around the hips of the body, which stands 1 m above the origin.
        assert np.abs(mesh.vertices.mean(axis=0) - STATE.trans).max() < 0.6
    assert fitter.fit(scan(toy_body, ("Top",), Top=on_faces(skirt(0.25, -0.5), 50)), STATE) == {}


def test_our_garment_is_not_simulated_since_nothing_moves(fitter, shown, ours, monkeypatch):
    wanted = fitter.fit(shown, STATE)[OURS][GARMENT]
    error_m = np.full(len(ours.space.mean), 0.05)
    ours.final_step = replace(ours.final_step, simulated_error_m=error_m)
    module = "drapeline.models.garment4d.ours.final_step"
    monkeypatch.setattr(f"{module}.simulate_proposals", None)
    found = fitter.fit(shown, STATE)[OURS][GARMENT]
    np.testing.assert_array_equal(found.vertices, wanted.vertices)


def test_points_have_the_labels_of_the_scan(fitter, shown, monkeypatch):
    monkeypatch.setattr("drapeline.models.garment4d.ours.labels.LabelStage.logits", None)
    assert set(fitter.fit(shown, STATE)) == {PCA, MOVED, POSED, OURS}


@pytest.fixture
def moving(toy_body):
    """A scan in the middle of seven frames of somebody in a skirt, relative to the root joint."""
    one = toy_sequences(toy_body)[-1]
    window = ScanWindow(one.points, one.labels.astype(np.uint8), one.poses, one.trans)
    body = BodyState.of(one.poses[window.middle], np.zeros(3), one.shape)
    points, labels = one.points[window.middle], window.labels[window.middle]
    return SegmentedScan("s", 3, points, labels, ("Skirt",), "female", body, None, window)


def in_order(seen):
    """Points of each frame by their first coordinate, with the labels of their places."""
    order = np.argsort(seen.points[..., 0], axis=1)
    taken = np.take_along_axis(seen.points, order[..., None], axis=1)
    return taken, np.take_along_axis(seen.labels, order, axis=1)


def test_models_of_sequences_are_given_the_window(fitter, moving, ours, monkeypatch):
    """All of its points, in some order, with their labels, poses and places."""
    given, guess = [], Guesser.guess

    def notice(self, seen, *rest):
        given.append(seen)
        return guess(self, seen, *rest)

    monkeypatch.setattr(Guesser, "guess", notice)
    found = fitter.fit(moving, moving.estimate)[OURS][GARMENT]
    (seen,) = given
    window = moving.window
    for part, expected in zip(
        (*in_order(seen), seen.poses, seen.trans),
        (*in_order(window), window.poses, window.trans),
        strict=True,
    ):
        np.testing.assert_array_equal(part, expected)
    laid = ours.final_step(guess(ours.guesser, seen).canonical, seen, ours.refining)
    np.testing.assert_allclose(found.vertices, laid.final[window.middle], atol=1e-5)


def test_a_window_shorter_than_what_models_take_is_a_body_that_stands_still(
    fitter, moving, ours, monkeypatch
):
    error_m = np.full(len(ours.space.mean), 0.05)
    ours.final_step = replace(ours.final_step, simulated_error_m=error_m)
    module = "drapeline.models.garment4d.ours.final_step"
    monkeypatch.setattr(f"{module}.simulate_proposals", None)
    short = ScanWindow(*(part[2:4] for part in moving.window))
    assert len(short.points) < ours.guesser.frames
    alone, found = (
        fitter.fit(replace(moving, window=window), moving.estimate) for window in (None, short)
    )
    assert alone.keys() == found.keys() == {PCA, MOVED, POSED, OURS}
    for variant, garments in alone.items():
        np.testing.assert_array_equal(found[variant][GARMENT].vertices, garments[GARMENT].vertices)
