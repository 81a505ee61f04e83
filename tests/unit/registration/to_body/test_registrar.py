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
from drapeline.registration.to_body.correspondence import Correspondence
from drapeline.registration.to_body.registrar import (
    Registrar,
    register_shard,
    round_trip,
    surface_distance,
)
from drapeline.registration.to_body.super_body import build_super_body
from drapeline.registration.to_body.topology import build_topology


def sheet(n=11, step=0.02, height=0.0):
    x, y = np.meshgrid(np.arange(n) * step, np.arange(n) * step)
    vertices = np.stack([x.ravel(), y.ravel(), np.full(n * n, height)], -1)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = [[corner, corner + 1, corner + n + 1], [corner, corner + n + 1, corner + n]]
    return vertices, np.concatenate([np.stack(f, -1) for f in faces])


def identity(count, mask=None):
    mask = np.ones(count, dtype=bool) if mask is None else mask
    corner = np.repeat(np.arange(count)[:, None], 3, 1).astype(np.int32)
    bary = np.tile(np.array([1, 0, 0], np.float32), (count, 1))
    return Correspondence(mask, corner, bary, 0, 0)


def test_parallel_sheets_are_as_far_apart_as_they_are():
    low, faces = sheet()
    high, _ = sheet(height=0.03)
    distance, angle, area = surface_distance(low, faces, high, faces)
    np.testing.assert_allclose(distance, 0.03, atol=1e-6)
    np.testing.assert_allclose(angle, 0, atol=0.1)
    assert area.sum() == pytest.approx(0.04)


def test_a_tilted_sheet_shows_its_angle():
    flat, faces = sheet()
    tilted = flat @ np.array([[1, 0, 0], [0, np.cos(0.3), np.sin(0.3)], [0, 0, 1.0]])
    _, angle, _ = surface_distance(flat, faces, tilted, faces)
    np.testing.assert_allclose(angle, np.degrees(0.3), atol=0.1)


def test_the_same_mesh_loses_nothing():
    vertices, faces = sheet(height=0.1)
    body, _ = sheet()
    found = {m.metric: m for m in round_trip(vertices, faces, body, faces, identity(len(body)))}
    for name in ("garment_to_rebuilt_max_mm", "rebuilt_to_garment_max_mm", "area_lost_percent"):
        assert found[name].value == pytest.approx(0, abs=1e-3)
    assert found["normal_error_deg"].value < 0.1
    assert {found[n].unit for n in ("garment_to_rebuilt_mean_mm", "normal_error_deg")} == {
        "mm",
        "deg",
    }


def test_a_missing_half_is_lost_area_one_way_only():
    vertices, faces = sheet()
    match = identity(len(vertices), vertices[:, 0] < 0.101)
    found = {m.metric: m.value for m in round_trip(vertices, faces, vertices, faces, match)}
    assert found["area_lost_percent"] == pytest.approx(45, abs=6)
    assert found["garment_to_rebuilt_max_mm"] == pytest.approx(100, abs=10)
    assert found["rebuilt_to_garment_max_mm"] == pytest.approx(0, abs=1e-3)


def test_faces_count_by_their_area():
    """Ever wider columns, of which the last ones are lost."""
    vertices, faces = sheet()
    vertices[:, 0] = 5 * vertices[:, 0] ** 2
    match = identity(len(vertices), np.arange(121) % 11 < 8)
    found = {m.metric: m.value for m in round_trip(vertices, faces, vertices, faces, match)}
    rebuilt = faces[match.mask[faces].all(axis=1)]
    distance, _, area = surface_distance(vertices, faces, vertices, rebuilt)
    by_area = 1000 * (distance * area).sum() / area.sum()
    assert by_area > 1.3 * 1000 * distance.mean()
    assert found["garment_to_rebuilt_mean_mm"] == pytest.approx(by_area)


def test_holes_and_islands_of_the_rebuilt_mesh_are_counted():
    vertices, faces = sheet()
    mask = np.ones(len(vertices), dtype=bool)
    mask[5 * 11 + 5] = False
    found = {
        m.metric: m.value for m in round_trip(vertices, faces, vertices, faces, identity(121, mask))
    }
    assert (found["holes_after"], found["islands_after"]) == (1, 0)
    mask = np.ones(121, dtype=bool)
    mask[3::11] = False
    found = {
        m.metric: m.value for m in round_trip(vertices, faces, vertices, faces, identity(121, mask))
    }
    assert found["islands_after"] == 1


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
        "Top", (vertices + shift).astype("f4"), faces, empty, empty, empty, empty, empty
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


def test_what_is_turned_over_at_the_top_is_not_registered(registrar, shell):
    """As the fall of a collar: a strip above the shell that comes down outside of it."""
    vertices, faces, body, _ = shell
    plain = registrar.register("Top", vertices, faces, body)
    top = vertices[:, 2].max()
    high = np.flatnonzero(vertices[:, 2] > top - 0.12)
    inner = faces[np.isin(faces, high).all(axis=1)]
    assert len(inner)
    axis = vertices.mean(axis=0) * [1, 1, 0]
    fall = vertices + 0.01 * (vertices - axis) / np.linalg.norm(vertices - axis, axis=1)[:, None]
    folded = np.concatenate([vertices, fall])
    both = np.concatenate([faces, inner[:, ::-1] + len(vertices)])
    done = registrar.register("Top", folded, both, body)
    np.testing.assert_array_equal(done.match.mask, plain.match.mask)
    np.testing.assert_allclose(done.offsets, plain.offsets, atol=1e-6)
