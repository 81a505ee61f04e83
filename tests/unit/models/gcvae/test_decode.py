"""Decoded garments in motion, with a decoder whose offsets are known."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from drapeline.bodies.kinematics import skin_points
from drapeline.bodies.model import posed_vertices
from drapeline.bodies.rest_body import rest_body, rest_to_pose
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import vertex_normals
from drapeline.metrics.garment import BodyInside
from drapeline.models.gcvae.data import DynamicGarments
from drapeline.models.gcvae.decode import decode_points, decode_points_for_display, resolve_points
from drapeline.registration.to_body.dynamic_offsets import dynamic_offsets
from drapeline.seeding import rng_for
from toys.moving import moving_garment

STATIC_CVAR = 13

HISTORY, CODE = 2, 3  # poses in the conditions, numbers of a static code
ROWS = np.array([1, 2, 5])


class KnownDecoder:
    """Decodes the code k to the k-th of the given offsets, and remembers the conditions."""

    resolves_penetration = False

    def __init__(self, offsets):
        self.offsets = torch.from_numpy(np.asarray(offsets, dtype=np.float32))
        self.seen = []

    def decode(self, z, cvar, topology):
        self.seen.append(cvar.numpy().copy())
        return self.offsets[z[:, 0].long()], None


@pytest.fixture
def moving(toy_body):
    return moving_garment(toy_body, "test", "Tshirt", wrinkle=0.01)


def frames_of(moving, version):
    """Frames of one garment as a dynamic VAE takes them; frame k is row k."""
    count = len(moving.poses)
    back = np.maximum(np.arange(count)[:, None] - np.arange(4), 0)
    data = SimpleNamespace(
        poses=moving.poses[back].astype(np.float32),
        garment_index=np.zeros(count, dtype=int),
        version=version,
        cvar=lambda garments: np.full((len(garments), STATIC_CVAR), 7, dtype=np.float32),
        topology=lambda rows: np.zeros(len(rows), dtype=int),
    )
    return DynamicGarments(data, np.full((1, CODE), 9, dtype=np.float32), HISTORY)


def codes(count):
    """z (n, 1) that stand for themselves."""
    return np.arange(count, dtype=np.float32)[:, None]


@pytest.mark.parametrize("version", ["posed", "unposed"])
def test_true_offsets_give_the_registered_points(toy_body, moving, version):
    offsets = dynamic_offsets(
        moving.registered,
        moving.cloth[ROWS],
        toy_body,
        moving.shape,
        moving.poses[ROWS],
        version,
    )
    garments = frames_of(moving, version)
    points = decode_points(KnownDecoder(offsets), garments, ROWS, moving, toy_body, codes(3))
    np.testing.assert_allclose(points, moving.points(ROWS), atol=1e-5)


def test_other_poses_reach_the_decoder_and_the_points(toy_body, moving):
    garments = frames_of(moving, "unposed")
    still = KnownDecoder(np.zeros((3, len(moving.registered.mask), 3)))
    rng = rng_for(0, "poses")
    poses = (np.tile(REST_POSE, (3, 4, 1)) + rng.normal(0, 0.2, (3, 4, 72))).astype(np.float32)
    points = decode_points(still, garments, ROWS, moving, toy_body, codes(3), poses)
    own = garments.cvar(ROWS)
    (cvar,) = still.seen
    past = STATIC_CVAR + 72 * HISTORY
    np.testing.assert_array_equal(cvar[:, STATIC_CVAR:past], poses[:, :HISTORY].reshape(3, -1))
    np.testing.assert_array_equal(cvar[:, :STATIC_CVAR], own[:, :STATIC_CVAR])
    np.testing.assert_array_equal(cvar[:, past:], own[:, past:])
    vertex = moving.registered.vertex
    rest = rest_body(toy_body, moving.shape)[vertex] + moving.registered.offsets[vertex]
    motions = rest_to_pose(toy_body, moving.shape, poses[:, 0])
    expected = skin_points(rest, motions, moving.registered.weights)
    np.testing.assert_allclose(points, expected, atol=1e-6)


@pytest.fixture
def topology(toy_body):
    return SimpleNamespace(faces=toy_body.faces, faces_of=lambda name: toy_body.faces)


def test_points_inside_the_body_are_pushed_out_of_it(toy_body, topology, moving):
    poses = moving.poses[ROWS[:1]]
    (body,) = posed_vertices(toy_body, moving.shape, poses)[0]
    inside = (body - 0.02 * vertex_normals(body, toy_body.faces))[moving.registered.vertex]
    (points,) = resolve_points(moving, toy_body, topology, inside[None], poses)
    before, after = map(BodyInside(body, toy_body.faces).depth, (inside, points))
    # Limbs of the toy body overlap: a few vertices of its surface lie too deep to be pushed out.
    assert (before > 0.01).mean() > 0.8
    assert (after > 0.002).mean() < 0.1


@pytest.mark.parametrize("resolves", [True, False])
def test_pictures_show_the_points_resolved_only_if_the_model_says_so(
    toy_body, topology, moving, resolves
):
    garments = frames_of(moving, "posed")
    model = KnownDecoder(np.zeros((1, len(moving.registered.mask), 3)))  # in the skin
    model.resolves_penetration = resolves
    rows = ROWS[:1]
    decoded = decode_points(model, garments, rows, moving, toy_body, codes(1))
    shown = decode_points_for_display(model, garments, rows, moving, toy_body, topology, codes(1))
    if resolves:
        resolved = resolve_points(moving, toy_body, topology, decoded, moving.poses[rows])
        np.testing.assert_allclose(shown, resolved, atol=1e-5)
        assert np.abs(shown - decoded).max() > 1e-3
    else:
        np.testing.assert_array_equal(shown, decoded)
