"""Whole sequences through trained networks."""

import logging

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from drapeline.dataset.scans import read_scans
from drapeline.errors import InputError
from drapeline.learning_data.body_relative_points import body_relative_points
from drapeline.models.garment4d.data import Seen, propose_garment
from drapeline.models.garment4d.ours.model import OurModel
from drapeline.models.garment4d.reconstruct import (
    NetworksModel,
    check_labels,
    estimate,
    reconstruct,
    seen_vertices,
)
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.models.garment4d.stages import PosedStage, load_stage
from drapeline.seeding import rng_for
from toys.garment4d import GARMENT, toy_bodies


@pytest.fixture
def shaken(identity):
    rng = rng_for(0, "shaken")
    with torch.no_grad():
        for parameter in identity.network.parameters():
            noise = 0.02 * rng.standard_normal(parameter.shape)
            parameter.add_(torch.from_numpy(noise.astype(np.float32)))
    return identity


def test_without_displacements_the_result_is_the_skinned_canonical_garment(identity, held_out):
    made = reconstruct(identity, held_out)
    np.testing.assert_allclose(made.final, made.proposal, atol=1e-6)
    faces, skinning = identity.space.faces, identity.settings.skinning
    expected = propose_garment(held_out.body, held_out.poses, made.canonical, faces, skinning)
    np.testing.assert_allclose(made.proposal, expected, atol=1e-6)
    assert made.labels.shape == held_out.points.shape[:2]


def test_the_canonical_garment_has_the_mean_coefficients_of_all_windows(identity, held_out):
    points = torch.from_numpy(np.array(held_out.points))
    network = identity.canonical.network
    with torch.inference_mode():
        # Seven frames in windows of three: the last one is shifted back.
        parts = [network(points[None, start : start + 3]).coefficients for start in (0, 3, 4)]
        expected = network.vertices(torch.cat(parts).mean(0, keepdim=True))[0].numpy()
    found = estimate(identity.canonical, held_out.points)
    np.testing.assert_allclose(found.canonical, expected, atol=1e-6)
    made = reconstruct(identity, held_out)
    np.testing.assert_allclose(made.canonical, expected, atol=1e-6)
    np.testing.assert_array_equal(made.labels, found.labels)


def test_what_the_canonical_network_said_need_not_be_asked_again(shaken, held_out):
    found = estimate(shaken.canonical, held_out.points, stride=2)
    made = reconstruct(shaken, held_out, stride=2, estimated=found)
    expected = reconstruct(shaken, held_out, stride=2)
    for key in ("labels", "canonical", "proposal", "final"):
        np.testing.assert_array_equal(getattr(made, key), getattr(expected, key))
    assert made.seconds > found.seconds


@pytest.mark.parametrize(("stride", "starts"), [(None, (0, 3, 4)), (1, (0, 1, 2, 3, 4))])
def test_frames_are_the_mean_of_the_windows_that_hold_them(shaken, held_out, stride, starts):
    made = reconstruct(shaken, held_out, stride=stride)
    body, normals = held_out.body.pose_surface(held_out.poses)
    total, held = np.zeros_like(made.final), np.zeros(len(made.final))
    for start in starts:
        span = slice(start, start + 3)
        window = {"proposal": made.proposal, "body": body, "body_normals": normals}
        batch = {k: torch.from_numpy(np.array(v[None, span])) for k, v in window.items()}
        points = torch.from_numpy(np.array(held_out.points[None, span]))
        with torch.inference_mode():
            found = shaken.predict(batch, shaken.estimate_canonical(points).levels)[-1]
        total[span] += found[0].numpy()
        held[span] += 1
    np.testing.assert_allclose(made.final, total / held[:, None, None], atol=2e-5)
    assert np.abs(made.final - made.proposal).max() > 1e-3


def test_displacements_of_a_whole_sequence_are_smoothed_over_frames(shaken, held_out):
    plain = reconstruct(shaken, held_out)
    shaken.settings = shaken.settings.replace(network={"smooth_passes": 2})
    away = (plain.final - plain.proposal).astype(np.float64)
    frames = len(away)
    mean = np.diag(np.full(frames, 2.0)) + np.eye(frames, k=1) + np.eye(frames, k=-1)
    mean[0, 0] = mean[-1, -1] = 3
    expected = plain.proposal + np.tensordot(mean @ mean / 16, away, axes=1)
    np.testing.assert_allclose(reconstruct(shaken, held_out).final, expected, atol=1e-6)


def test_the_order_of_the_points_does_not_matter(shaken, held_out):
    made = reconstruct(shaken, held_out)
    order = rng_for(0, "order").permutation(held_out.points.shape[1])
    turned = reconstruct(shaken, held_out._replace(points=held_out.points[:, order]))
    np.testing.assert_allclose(turned.final, made.final, atol=1e-5)
    np.testing.assert_array_equal(turned.labels, made.labels[:, order])


def test_a_walk_elsewhere_gives_the_same_garment(shaken, data, held_out, toy_body, tmp_path):
    """Networks see coordinates relative to the root joint, so places in the world do not matter."""
    sequence = int(data.of_split("test")[0])
    made = []
    for start in ([0.5, -0.25, 1.0], [-8.0, 16.0, 1.0]):  # sums without rounding
        trans = np.array(start) + 0.125 * np.arange(len(held_out.poses))[:, None]
        points = np.asarray(held_out.points, dtype=np.float64)
        np.savez(tmp_path / "scans.npz", points=points + trans[:, None])
        body = {"poses": held_out.poses, "shape": data.shape[sequence], "gender": "female"}
        np.savez(tmp_path / "body.npz", trans=trans, **body)
        scans = read_scans(tmp_path / "scans.npz", tmp_path / "body.npz", toy_bodies(toy_body))
        points = np.stack([scan.points for scan in scans.scans])
        seen = Seen(points, scans.body.poses, scans.body.trans, held_out.body)
        made.append(reconstruct(shaken, seen).final)
    np.testing.assert_allclose(made[0], made[1], atol=1e-6)


def test_turning_body_and_points_turns_proposals_and_leaves_where_on_the_body_points_are(
    data, held_out
):
    """About the vertical. Networks see coordinates turned as the world, so they may tell fronts.

    Skinning, body-relative points and our final step (see its own test) do not depend on where a
    body faces.
    """
    turn = Rotation.from_euler("z", 1.1)
    poses = np.array(held_out.poses, dtype=np.float64)
    poses[:, :3] = (turn * Rotation.from_rotvec(poses[:, :3])).as_rotvec()
    points = (held_out.points @ turn.as_matrix().T).astype(np.float32)
    body, canonical = held_out.body, data.canonical[0]
    before, after = (
        body_relative_points(body.model, body.shape, x, y)
        for x, y in ((held_out.poses, held_out.points), (poses, points))
    )
    np.testing.assert_allclose(after[..., :3], points, atol=1e-6)
    np.testing.assert_allclose(after[..., 3:], before[..., 3:], atol=2e-3)
    before, after = (
        propose_garment(
            body, x, canonical, data.space.faces, SkinningSettings(neighbours=16, passes=5)
        )
        for x in (held_out.poses, poses)
    )
    np.testing.assert_allclose(after, before @ turn.as_matrix().T, atol=1e-5)


def test_clouds_without_a_garment_still_give_one(shaken, held_out):
    nothing = held_out._replace(labels=np.zeros(held_out.points.shape[:2], dtype=np.uint8))
    made = reconstruct(shaken, nothing)
    assert np.isfinite(made.final).all()
    np.testing.assert_array_equal(made.labels, nothing.labels)
    np.testing.assert_allclose(reconstruct(shaken, nothing).final, made.final, atol=1e-6)


def test_known_labels_choose_the_points_that_a_garment_is_made_of(shaken, data, held_out):
    true = data.labels[data.rows(int(data.of_split("test")[0]))]
    made = reconstruct(shaken, held_out._replace(labels=true))
    found = estimate(shaken.canonical, held_out.points, labels=true)
    np.testing.assert_array_equal(made.labels, true)
    np.testing.assert_array_equal(made.canonical, found.canonical)
    # What the network itself takes the points for is told none the less.
    own = estimate(shaken.canonical, held_out.points)
    np.testing.assert_array_equal(found.labels, own.labels)
    assert np.abs(own.canonical - found.canonical).max() > 1e-6


def test_a_sequence_shorter_than_a_window_is_refused(identity, held_out):
    with pytest.raises(InputError, match="2 frames, expected at least 3"):
        reconstruct(identity, held_out.frames(np.arange(2)))


def test_a_stride_longer_than_a_window_is_refused(identity, held_out):
    with pytest.raises(InputError, match="stride of 4, expected at most 3"):
        reconstruct(identity, held_out, stride=4)


def taken(*shares):
    """(F, 1000) of which these shares are taken for the garment."""
    return np.arange(1000) < 1000 * np.array(shares)[:, None]


def test_scans_without_the_garment_are_refused_by_their_share_over_all_frames():
    with pytest.raises(InputError, match=r"^walk: 1\.9% of the points are taken for Skirt, exp"):
        check_labels("walk", taken(0.0, 0.038), "Skirt")
    check_labels("walk", taken(0.0, 0.040), "Skirt")


def test_single_frames_without_it_are_named(caplog):
    with caplog.at_level(logging.WARNING, logger="drapeline"):
        check_labels("walk", taken(0.3, 0.019, 0.02, 0.3), "Skirt")
    (record,) = caplog.records
    assert record.getMessage() == (
        "walk: frame 2: 1.9 % of the points are taken for Skirt; it follows other frames there"
    )


@pytest.fixture(params=[NetworksModel, OurModel])
def model(request, trained_posed, fitted_ours):
    """From its folder; the data of its training is not needed."""
    folders = {NetworksModel: trained_posed, OurModel: fitted_ours}
    return request.param(folders[request.param], "cpu")


def answer(model, points, worn, **others):
    """Whatever the toys' networks take the points for."""
    return model.reconstruct(points, worn.poses, worn.shape, least_share=0, **others)


@pytest.fixture
def worn(toy_skirts):
    return toy_skirts[-1]


def test_a_garment_is_what_the_model_makes_of_the_clouds(model, worn, held_out):
    made = answer(model, held_out.points, worn)
    steps = model.make(held_out._replace(points=made.points))
    np.testing.assert_allclose(made.vertices, steps.final, atol=1e-5)
    np.testing.assert_allclose(made.canonical, steps.canonical, atol=1e-5)
    np.testing.assert_array_equal(made.labels, steps.labels)
    np.testing.assert_array_equal(made.faces, model.space.faces)
    assert made.garment == model.garment == GARMENT
    assert made.labels.shape == made.points.shape[:2] == held_out.points.shape[:2]
    # The same points in another order.
    for own, asked in zip(made.points, held_out.points, strict=True):
        np.testing.assert_allclose(np.sort(own, axis=0), np.sort(asked, axis=0), atol=1e-6)


def test_the_paper_s_networks_give_what_they_are_trained_to_give(trained_posed, held_out):
    model = NetworksModel(trained_posed, "cpu")
    made = model.make(held_out)
    wanted = reconstruct(load_stage(trained_posed, PosedStage), held_out)
    for key in ("labels", "canonical", "proposal", "final"):
        np.testing.assert_array_equal(getattr(made, key), getattr(wanted, key))
    with pytest.raises(InputError, match="holds a 'garment4d_posed' network, expected garment4d_o"):
        OurModel(trained_posed, "cpu")


def test_clouds_of_any_size_that_are_somewhere_are_answered_where_they_are(model, worn, held_out):
    trans = np.array([3.0, -2.0, 0.9]) + 0.01 * np.arange(len(worn.poses))[:, None]
    clouds = [
        np.concatenate([points, points[:count]]) + root
        for count, (points, root) in enumerate(zip(held_out.points, trans, strict=True))
    ]
    moved = answer(model, clouds, worn, trans=trans)
    here = answer(model, held_out.points, worn)
    away = moved.vertices - here.vertices - trans[:, None]
    assert np.abs(away).mean() < 0.02
    assert np.abs(moved.points.mean(axis=1) - trans).max() < 1.5


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"gender": "child"}, "points: the body: gender is 'child', expected female, male"),
        ({"shape": np.zeros(9)}, r"points: the body: shape has shape \(9,\)"),
        ({"trans": np.ones((7, 2))}, r"points: the body: trans has shape \(7, 2\)"),
        ({"poses": np.zeros((6, 72))}, "points: 7 frames, but 6 poses"),
        ({"points": np.full((7, 9, 3), np.nan)}, "points: frame 1: 9 of 9 points hold NaN"),
        ({"points": 1000 * np.eye(3)[None].repeat(7, 0)}, "millimetres"),
        ({"least_share": 0.9}, "of the points are taken for Skirt, expected 90% or more"),
    ],
)
def test_what_cannot_be_answered_is_refused_in_one_sentence(
    model, worn, held_out, changed, message
):
    asked = {"points": held_out.points, "poses": worn.poses, "shape": worn.shape, **changed}
    with pytest.raises(InputError, match=message):
        model.reconstruct(asked.pop("points"), asked.pop("poses"), asked.pop("shape"), **asked)


def test_too_few_frames_are_refused(model, worn, held_out):
    with pytest.raises(InputError, match="2 frames, expected at least 3"):
        model.reconstruct(held_out.points[:2], worn.poses[:2], worn.shape)


def test_vertices_are_seen_where_points_of_the_garment_lie_next_to_them():
    row = np.stack([np.arange(20) * 0.05, np.zeros(20), np.zeros(20)], axis=1)
    garment = np.stack([row, row]).astype(np.float32)
    points = garment + np.float32([0, 0.01, 0])
    chosen = np.zeros((2, 20), dtype=bool)
    chosen[0, :8] = True
    seen = seen_vertices(garment, points, chosen)
    assert seen[0, :8].all()
    assert not seen[0, 12:].any()
    assert not seen[1].any()
