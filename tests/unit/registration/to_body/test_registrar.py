"""Garments registered on the toy body: a shell whose offsets are known, and shards."""

import numpy as np
import pytest

from drapeline.bodies.rest_body import rest_body
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.geometry.mesh import faces_within, vertex_normals
from drapeline.outfits.garment_types import GARMENTS
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.outfits.static import StaticOutfit
from drapeline.registration.to_body.registrar import Registrar, register_shard
from drapeline.registration.to_body.super_body import build_super_body
from drapeline.registration.to_body.topology import build_topology

GAP_M = 0.015
SHAPE = np.array([0.5, -0.5, *[0.0] * 8])


@pytest.fixture(scope="module")
def refined(toy_body):
    return build_super_body({gender: toy_body for gender in GENDERS}, 2500)


@pytest.fixture(scope="module")
def registrar(refined):
    return Registrar(build_topology(refined))


@pytest.fixture(scope="module")
def shell(refined):
    """A tube around the torso, 1.5 cm outside of the body: vertices, faces, body, mask."""
    body = rest_body(refined.bodies["female"], SHAPE)
    mask = (np.abs(body[:, 2] - 0.1) < 0.12) & (np.abs(body[:, 0]) < 0.2)
    vertices = body + GAP_M * vertex_normals(body, refined.faces)
    ids, faces = np.unique(faces_within(refined.faces, mask), return_inverse=True)
    covered = np.zeros(len(body), dtype=bool)
    covered[ids] = True
    return vertices[ids], faces.reshape(-1, 3), body, covered


def outfit(shell, shift=0.0):
    vertices, faces, *_ = shell
    empty = np.zeros(0, np.float32)
    garment = Garment(
        "Top", (vertices + shift).astype("f4"), faces, empty, empty, pin=empty, elastic=empty
    )
    return Outfit((garment,), SHAPE, np.zeros(2), np.array([-0.3, 0.4]), "female")


def test_a_shell_around_the_torso_has_offsets_as_long_as_its_gap(registrar, shell):
    vertices, faces, body, covered = shell
    done = registrar.register("Top", vertices, faces, body)
    found = done.match.mask
    assert (found & covered).sum() > 0.95 * (found | covered).sum()
    length = np.linalg.norm(done.offsets[found & covered], axis=1)
    assert np.median(length) == pytest.approx(GAP_M, abs=0.002)
    assert not done.offsets[~found].any()
    measures = {m.metric: m.value for m in done.measures}
    assert measures["garment_to_rebuilt_mean_mm"] < 2
    assert measures["holes_after"] == measures["islands_after"] == 0


def test_a_garment_beside_the_body_is_refused(registrar, shell):
    vertices, faces, body, _ = shell
    with pytest.raises(InputError, match="Top: covers no part of the body"):
        registrar.register("Top", vertices[:, [1, 2, 0]] + 3.0, faces[:, ::-1], body)


def test_a_shard_has_a_row_per_garment_and_names_the_outfit_that_fails(registrar, refined, shell):
    shard = [StaticOutfit("s00001", "train", outfit(shell))]
    arrays, errors = register_shard(registrar, shard, refined.bodies)
    assert {name: len(array) for name, array in arrays.items()} == dict.fromkeys(arrays, 1)
    assert arrays["garment"][0] == GARMENTS.index("Top")
    assert (arrays["outfit"][0], arrays["split"][0]) == ("s00001", "train")
    np.testing.assert_allclose(arrays["tightness"][0], [-0.3, 0.4], atol=1e-6)
    assert {row["name"] for row in errors} == {"s00001"}
    shard.append(StaticOutfit("s00002", "test", outfit(shell, shift=3.0)))
    with pytest.raises(InputError, match="outfit s00002: Top: covers no part"):
        register_shard(registrar, shard, refined.bodies)
