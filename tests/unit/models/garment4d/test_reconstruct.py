"""Whole toy sequences through networks whose answer is known."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from drapeline.dataset.scans import read_scans
from drapeline.errors import InputError
from drapeline.learning_data.body_relative_points import body_relative_points
from drapeline.models.garment4d.data import propose_garment
from drapeline.models.garment4d.reconstruct import (
    estimate,
    reconstruct,
    refine,
)
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.registration.settings import RefineSettings
from drapeline.seeding import rng_for
from toys.garment4d import (
    toy_bodies,
)


@pytest.fixture
def shaken(identity):
    rng = rng_for(0, "shaken")
    with torch.no_grad():
        for parameter in identity.network.parameters():
            noise = 0.02 * rng.standard_normal(parameter.shape)
            parameter.add_(torch.from_numpy(noise.astype(np.float32)))
    return identity


def test_without_displacements_the_result_is_the_skinned_canonical_garment(identity, given):
    made = reconstruct(identity, **given)
    np.testing.assert_allclose(made.final, made.proposal, atol=1e-6)
    faces, skinning = identity.space.faces, identity.settings.skinning
    expected = propose_garment(given["body"], given["poses"], made.canonical, faces, skinning)
    np.testing.assert_allclose(made.proposal, expected, atol=1e-6)
    assert made.labels.shape == given["points"].shape[:2]


def test_the_canonical_garment_has_the_mean_coefficients_of_all_windows(identity, given):
    points = torch.from_numpy(np.array(given["points"]))
    network = identity.canonical.network
    with torch.inference_mode():
        # Seven frames in windows of three: the last one is shifted back.
        parts = [network(points[None, start : start + 3]).coefficients for start in (0, 3, 4)]
        expected = network.vertices(torch.cat(parts).mean(0, keepdim=True))[0].numpy()
    found = estimate(identity.canonical, **given)
    np.testing.assert_allclose(found.canonical, expected, atol=1e-6)
    made = reconstruct(identity, **given)
    np.testing.assert_allclose(made.canonical, expected, atol=1e-6)
    np.testing.assert_array_equal(made.labels, found.labels)


def test_what_the_canonical_network_said_need_not_be_asked_again(shaken, given):
    found = estimate(shaken.canonical, **given, stride=2)
    made = reconstruct(shaken, **given, stride=2, estimated=found)
    expected = reconstruct(shaken, **given, stride=2)
    for key in ("labels", "canonical", "proposal", "final"):
        np.testing.assert_array_equal(getattr(made, key), getattr(expected, key))
    assert made.seconds > found.seconds


@pytest.mark.parametrize(("stride", "starts"), [(None, (0, 3, 4)), (1, (0, 1, 2, 3, 4))])
def test_frames_are_the_mean_of_the_windows_that_hold_them(shaken, given, stride, starts):
    made = reconstruct(shaken, **given, stride=stride)
    body, normals = given["body"].pose_surface(given["poses"])
    total, held = np.zeros_like(made.final), np.zeros(len(made.final))
    for start in starts:
        span = slice(start, start + 3)
        window = {"proposal": made.proposal, "body": body, "body_normals": normals}
        batch = {k: torch.from_numpy(np.array(v[None, span])) for k, v in window.items()}
        points = torch.from_numpy(np.array(given["points"][None, span]))
        with torch.inference_mode():
            found = shaken.predict(batch, shaken.estimate_canonical(points).levels)[-1]
        total[span] += found[0].numpy()
        held[span] += 1
    np.testing.assert_allclose(made.final, total / held[:, None, None], atol=2e-5)
    assert np.abs(made.final - made.proposal).max() > 1e-3


def test_displacements_of_a_whole_sequence_are_smoothed_over_frames(shaken, given):
    plain = reconstruct(shaken, **given)
    shaken.settings = shaken.settings.replace(network={"smooth_passes": 2})
    away = (plain.final - plain.proposal).astype(np.float64)
    frames = len(away)
    mean = np.diag(np.full(frames, 2.0)) + np.eye(frames, k=1) + np.eye(frames, k=-1)
    mean[0, 0] = mean[-1, -1] = 3
    expected = plain.proposal + np.tensordot(mean @ mean / 16, away, axes=1)
    np.testing.assert_allclose(reconstruct(shaken, **given).final, expected, atol=1e-6)


def test_the_order_of_the_points_does_not_matter(shaken, given):
    made = reconstruct(shaken, **given)
    order = rng_for(0, "order").permutation(given["points"].shape[1])
    turned = reconstruct(shaken, **{**given, "points": given["points"][:, order]})
    np.testing.assert_allclose(turned.final, made.final, atol=1e-5)
    np.testing.assert_array_equal(turned.labels, made.labels[:, order])


def test_a_walk_elsewhere_gives_the_same_garment(shaken, data, given, toy_body, tmp_path):
    """Networks see coordinates relative to the root joint, so places in the world do not matter."""
    sequence = int(data.of_split("test")[0])
    made = []
    for start in ([0.5, -0.25, 1.0], [-8.0, 16.0, 1.0]):  # sums without rounding
        trans = np.array(start) + 0.125 * np.arange(len(given["poses"]))[:, None]
        points = np.asarray(given["points"], dtype=np.float64)
        np.savez(tmp_path / "scans.npz", points=points + trans[:, None])
        body = {"poses": given["poses"], "shape": data.shape[sequence], "gender": "female"}
        np.savez(tmp_path / "body.npz", trans=trans, **body)
        scans = read_scans(tmp_path / "scans.npz", tmp_path / "body.npz", toy_bodies(toy_body))
        points = np.stack([scan.points for scan in scans.scans])
        made.append(reconstruct(shaken, points, scans.body.poses, given["body"]).final)
    np.testing.assert_allclose(made[0], made[1], atol=1e-6)


def test_turning_body_and_points_turns_proposals_and_leaves_where_on_the_body_points_are(
    data, given
):
    """About the vertical. Networks see coordinates turned as the world, so they may tell fronts.

    Skinning, body-relative points and our last step (see its own test) do not depend on where a
    body faces.
    """
    turn = Rotation.from_euler("z", 1.1)
    poses = np.array(given["poses"], dtype=np.float64)
    poses[:, :3] = (turn * Rotation.from_rotvec(poses[:, :3])).as_rotvec()
    points = (given["points"] @ turn.as_matrix().T).astype(np.float32)
    body, canonical = given["body"], data.canonical[0]
    before, after = (
        body_relative_points(body.model, body.shape, x, y)
        for x, y in ((given["poses"], given["points"]), (poses, points))
    )
    np.testing.assert_allclose(after[..., :3], points, atol=1e-6)
    np.testing.assert_allclose(after[..., 3:], before[..., 3:], atol=2e-3)
    before, after = (
        propose_garment(
            body, x, canonical, data.space.faces, SkinningSettings(neighbours=16, passes=5)
        )
        for x in (given["poses"], poses)
    )
    np.testing.assert_allclose(after, before @ turn.as_matrix().T, atol=1e-5)


def test_clouds_without_a_garment_still_give_one(shaken, given):
    nothing = np.zeros(given["points"].shape[:2], dtype=np.uint8)
    made = reconstruct(shaken, **given, labels=nothing)
    assert np.isfinite(made.final).all()
    np.testing.assert_allclose(
        reconstruct(shaken, **given, labels=nothing).final, made.final, atol=1e-6
    )


def test_a_sequence_shorter_than_a_window_is_refused(identity, given):
    short = {**given, "points": given["points"][:2], "poses": given["poses"][:2]}
    with pytest.raises(InputError, match="2 frames, expected at least 3"):
        reconstruct(identity, **short)


def test_a_stride_longer_than_a_window_is_refused(identity, given):
    with pytest.raises(InputError, match="stride of 4, expected at most 3"):
        reconstruct(identity, **given, stride=4)


def test_our_variant_follows_the_points_and_keeps_to_the_cloth(identity, data, given):
    sequence = int(data.of_split("test")[0])
    true = data.garment[data.rows(sequence)]
    made = reconstruct(identity, **given)
    # The true canonical garment and the true labels, so that only the sway is left to find.
    proposal = propose_garment(
        given["body"],
        given["poses"],
        data.canonical[sequence],
        data.space.faces,
        identity.settings.skinning,
    )
    made = made._replace(
        labels=data.labels[data.rows(sequence)],
        canonical=data.canonical[sequence],
        proposal=proposal,
        final=proposal,
    )
    # Thirty body points tell nothing of where the body ends: no gap is asked for.
    settings = RefineSettings(gap_m=-1.0)
    found = refine(made, **given, label=data.label, faces=data.space.faces, settings=settings)
    before, after = (np.linalg.norm(x - true, axis=-1).mean() for x in (proposal, found))
    assert after < 0.85 * before
