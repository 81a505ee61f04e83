"""The tube that skirts are laid on."""

import numpy as np
import pytest

from drapeline.bodies.rest_body import rest_body
from drapeline.geometry.mesh import boundary_edges, edges, triangulate, vertex_normals
from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.generate import sample_outfit
from drapeline.outfits.templates import build_templates
from drapeline.registration.to_body.registrar import Registrar
from drapeline.registration.to_body.skirt_tube import SkirtTube
from drapeline.registration.to_body.super_body import build_super_body
from drapeline.registration.to_body.topology import build_topology, skirt_body
from drapeline.seeding import rng_for


@pytest.fixture(scope="module")
def made(toy_body):
    refined = build_super_body({"female": toy_body, "male": toy_body}, 3000)
    return refined, build_topology(refined)


@pytest.fixture(scope="module")
def skirt(toy_body):
    outfit = sample_outfit(
        rng_for(5, "skirt"),
        build_templates(toy_body),
        toy_body,
        gender="female",
        shape=np.zeros(10),
        outfit_type="Skirt",
        edge_length_m=0.025,
        ranges=OutfitRanges(fits=("regular",), skirt_length=(0.5, 0.6)),
    )
    return outfit.garments[0]


def long_edges(vertices, faces, moved):
    pairs = edges(faces)
    pairs = pairs[np.isin(pairs, moved).any(axis=1)]
    lengths = np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1)
    return np.percentile(lengths, 99)


def nothing():
    return np.zeros((0, 3)), np.zeros(0, dtype=int)


def test_the_tube_is_convex_around_and_faces_outwards(made):
    refined, topology = made
    body = rest_body(refined.bodies["female"], np.zeros(10))
    tube = SkirtTube(topology)
    standing = tube(body, *nothing())
    low = np.setdiff1d(tube.moved, np.flatnonzero(body[:, 2] > body[tube.moved, 2].max() - 0.1))
    normals = vertex_normals(standing, topology.skirt_faces)
    middle = standing[low].mean(0) * [1, 1, 0] + standing[low] * [0, 0, 1]
    assert ((standing[low] - middle) * normals[low]).sum(1).min() > 0
    untouched = np.setdiff1d(np.arange(len(body)), tube.moved)
    np.testing.assert_array_equal(standing[untouched], body[untouched])


def test_shares_run_from_the_front_over_the_left_side(made):
    refined, topology = made
    tube = SkirtTube(topology)
    standing = tube(rest_body(refined.bodies["female"], np.zeros(10)), *nothing())[tube.moved]
    low = standing[:, 2] < standing[:, 2].max() - 0.1
    x, y = (standing[low, :2] - standing[low, :2].mean(axis=0)).T
    turn = np.arctan2(x, -y)  # 0 in front, 90 degrees at the left side, which is +X
    assert np.cos(2 * np.pi * tube.share[low] - turn).mean() > 0.5


def test_below_its_hem_a_skirt_goes_on_as_it_widens(made):
    refined, topology = made
    body = rest_body(refined.bodies["female"], np.zeros(10))
    tube = SkirtTube(topology)
    top, low = body[tube.moved, 2].max(), body[tube.moved, 2].min()
    end = 0.4 * top + 0.6 * low
    height, turn = np.meshgrid(np.linspace(top, end, 40), np.linspace(0, 2 * np.pi, 90))
    radius = 0.35 + 0.5 * (top - height)
    cone = np.stack([radius * np.cos(turn), radius * np.sin(turn), height], -1).reshape(-1, 3)
    hem = np.flatnonzero(cone[:, 2] == cone[:, 2].min())
    placed = tube(body, cone, hem)[tube.moved]
    below = placed[placed[:, 2] < end - 0.05]
    expected = 0.35 + 0.5 * (top - below[:, 2])
    np.testing.assert_allclose(np.linalg.norm(below[:, :2], axis=1), expected, atol=0.03)


def test_vertices_are_spread_more_evenly_than_by_smoothing(made):
    refined, topology = made
    body = rest_body(refined.bodies["female"], np.zeros(10))
    tube = SkirtTube(topology)
    smoothed = long_edges(skirt_body(topology, body), topology.skirt_faces, tube.moved)
    even = long_edges(tube(body, *nothing()), topology.skirt_faces, tube.moved)
    assert even < 0.8 * smoothed


@pytest.mark.parametrize("first", [-2.0, 0.0, 2.0])
def test_a_skirt_comes_back_from_its_offsets(made, skirt, first):
    refined, topology = made
    shape = np.zeros(10)
    body = rest_body(refined.bodies["female"], shape)
    wide = skirt.vertices * [1 + 0.1 * first, 1, 1]
    done = Registrar(topology).register("Skirt", wide, skirt.faces, body)
    found = {m.metric: m.value for m in done.measures}
    assert found["garment_to_rebuilt_mean_mm"] < 3
    assert found["rebuilt_to_garment_mean_mm"] < 3
    assert found["holes_after"] == found["islands_after"] == 0
    boundary = np.unique(boundary_edges(triangulate(skirt.faces)))
    hem = wide[boundary][:, 2].min()
    lowest = (body + done.offsets)[done.match.mask][:, 2].min()
    assert lowest == pytest.approx(hem, abs=0.01)
