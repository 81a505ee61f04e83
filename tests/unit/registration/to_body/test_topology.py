"""The second topology, smoothing of the inner legs, and the segments."""

from collections import Counter
from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull

from drapeline.bodies.model import posed_vertices
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import boundary_loops, edge_counts, edges
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.inner_legs import skirt_topology
from drapeline.registration.to_body.segments import (
    MIDDLE,
    PAIRS,
    SEGMENTS,
    segment_body,
    vertex_areas,
)
from drapeline.registration.to_body.super_body import build_super_body
from drapeline.registration.to_body.topology import (
    build_topology,
    load_topology,
    save_topology,
    skirt_body,
    topology_codes,
)


@pytest.fixture(scope="module", params=["symmetric", "rough"])
def made(request, toy_body):
    """A refined body and its topology."""
    body = toy_body
    if request.param == "rough":
        noise = np.random.default_rng(0).normal(0, 5e-4, body.v_template.shape)
        body = replace(body, v_template=(body.v_template + noise).astype("f4"))
    refined = build_super_body({"female": body, "male": body}, 3000)
    return refined, build_topology(refined)


def half_edges(faces):
    return Counter(map(tuple, np.stack([faces, np.roll(faces, -1, 1)], -1).reshape(-1, 2).tolist()))


def pieces(pairs, count):
    graph = csr_matrix((np.ones(len(pairs)), pairs.T), shape=(count, count))
    return connected_components(graph, directed=False)[0]


def section(vertices, faces, height):
    """(P, 2) where edges cross a plane, and the area that the cut's segments enclose."""
    points, area = [], 0.0
    for face in faces:
        z = vertices[face, 2] - height
        if (z > 0).all() or (z <= 0).all():
            continue
        ends = []
        for k in range(3):
            a, b = vertices[face[k]], vertices[face[k - 2]]
            if (z[k] > 0) != (z[k - 2] > 0):
                end = a + (b - a) * z[k] / (z[k] - z[k - 2])
                ends.append((z[k] > 0, end[:2]))
        (_, tail), (_, head) = sorted(ends, key=lambda e: e[0])
        points += [tail, head]
        area += (tail[0] * head[1] - tail[1] * head[0]) / 2
    return np.array(points), abs(area)


def test_legs_become_one_tube(made):
    _, topology = made
    faces, count = topology.skirt_faces, len(topology.rest)
    pairs, sides = edge_counts(faces)
    assert sides.max() == 2
    assert max(half_edges(faces).values()) == 1  # neighbours agree on which side is outside
    np.testing.assert_array_equal(np.unique(faces), np.arange(count))
    assert count - len(pairs) + len(faces) == 2 - 4  # a sphere with four holes
    assert pieces(pairs, count) == 1
    loops = boundary_loops(faces)
    assert len(loops) == 4
    hem = min(loops, key=lambda loop: topology.rest[loop, 2].mean())
    assert (topology.rest[hem, 0] > 0.05).any()
    assert (topology.rest[hem, 0] < -0.05).any()


def test_only_the_inner_line_of_the_legs_differs(made):
    _, topology = made
    ours = {tuple(sorted(f)) for f in topology.faces.tolist()}
    theirs = {tuple(sorted(f)) for f in topology.skirt_faces.tolist()}
    added = {tuple(sorted(f)) for f in topology.skirt_faces[-int(topology.joining) :].tolist()}
    assert theirs - ours == added
    x = topology.rest[np.array(sorted(added)), 0]
    assert (x.max(axis=1) > 0).any()
    assert (np.ptp(np.sign(x), axis=1) > 0).mean() > 0.9  # they lead from one leg to the other
    removed = np.unique(np.array(sorted(ours - theirs)))
    assert topology.rest[removed, 2].max() < 0
    assert set(removed.tolist()) <= set(np.flatnonzero(topology.inner_leg).tolist())


def test_garments_choose_their_topology(made):
    _, topology = made
    for garment in ("Tshirt", "Top", "Trousers", "Jumpsuit"):
        assert topology.faces_of(garment) is topology.faces
    for garment in ("Skirt", "Dress"):
        assert topology.faces_of(garment) is topology.skirt_faces


def test_smoothed_vertices_lie_on_the_mean_of_their_neighbours(made):
    refined, topology = made
    shape = np.random.default_rng(5).uniform(-3, 3, 10)
    body = posed_vertices(refined.bodies["male"], shape, REST_POSE[None])[0][0]
    tube = skirt_body(topology, body)
    assert tube.dtype == body.dtype
    fixed = ~topology.inner_leg
    np.testing.assert_array_equal(tube[fixed], body[fixed])
    assert np.abs(tube - body).max() > 0.02
    pairs, sides = edge_counts(topology.skirt_faces)
    hem = set(pairs[sides == 1].ravel().tolist())
    near = {}
    for (a, b), side in zip(pairs.tolist(), sides.tolist(), strict=True):
        for start, end in ((a, b), (b, a)):
            if start not in hem or side == 1:
                near.setdefault(start, []).append(end)
    for vertex in np.flatnonzero(topology.inner_leg).tolist():
        np.testing.assert_allclose(tube[vertex], tube[near[vertex]].mean(axis=0), atol=1e-5)


@pytest.mark.parametrize("height", [-0.35, -0.55, -0.75])
def test_a_cut_through_the_smoothed_legs_is_nearly_convex(made, height):
    _, topology = made
    rest = topology.rest.astype(np.float64)
    tube = skirt_body(topology, rest)

    def filled(vertices):
        points, area = section(vertices, topology.skirt_faces, height)
        return area / ConvexHull(points).volume

    assert filled(tube) > 0.95
    assert filled(rest) < 0.9


def test_a_body_whose_legs_end_too_soon_is_refused(made):
    _, topology = made
    with pytest.raises(ValueError, match="no strip of faces"):
        skirt_topology(topology.rest.astype(float), topology.faces, hips=-0.5)


def test_legs_that_cannot_be_joined_name_the_body(made):
    refined, _ = made
    female = refined.bodies["female"]
    joints = female.J_regressor.copy()
    joints[[1, 2]] = joints[[4, 5]]  # hip joints at the knees: no legs meet below them
    kneeling = replace(female, J_regressor=joints, name="kneeling")
    with pytest.raises(InputError, match="kneeling: no strip of faces .* expected two legs apart"):
        build_topology(replace(refined, bodies={"female": kneeling}))


def test_twenty_one_segments_each_in_one_piece_in_both_topologies(made):
    _, topology = made
    np.testing.assert_array_equal(np.unique(topology.segments), np.arange(SEGMENTS))
    for faces in (topology.faces, topology.skirt_faces):
        pairs = edges(faces)
        for segment in range(SEGMENTS):
            inside = topology.segments == segment
            within = pairs[inside[pairs].all(axis=1)]
            assert pieces(within, len(inside)) == 1 + (~inside).sum()


def test_segments_of_both_sides_are_mirror_images(toy_body):
    refined = build_super_body({"female": toy_body, "male": toy_body}, 2500)
    topology = build_topology(refined)
    swap = np.r_[0:MIDDLE, MIDDLE + PAIRS : SEGMENTS, MIDDLE : MIDDLE + PAIRS]
    aside = np.abs(topology.rest[:, 0]) > 1e-4
    mirrored = swap[topology.segments[refined.mirror]]
    np.testing.assert_array_equal(mirrored[aside], topology.segments[aside])


def test_segments_are_smaller_where_offsets_vary_more(made):
    _, topology = made
    rest = topology.rest.astype(np.float64)
    areas = vertex_areas(rest, topology.faces)
    shins = rest[:, 2] < -0.45

    def in_shins(variability):
        segments = segment_body(rest, topology.faces, topology.skirt_faces, variability)
        middles = [
            np.average(shins[segments == k], weights=areas[segments == k]) for k in range(21)
        ]
        return (np.array(middles) > 0.5).sum()

    even = np.full(len(rest), 0.02)
    assert in_shins(np.where(shins, 0.2, 0.02)) >= in_shins(even) + 4


def test_a_saved_topology_loads_as_it_was(made, tmp_path):
    _, topology = made
    save_topology(tmp_path / "topology.npz", topology)
    loaded = load_topology(tmp_path / "topology.npz")
    for field in fields(topology):
        np.testing.assert_array_equal(getattr(loaded, field.name), getattr(topology, field.name))
    np.testing.assert_array_equal(
        skirt_body(loaded, loaded.rest), skirt_body(topology, topology.rest)
    )
    with pytest.raises(InputError, match="other.npz: no such file"):
        load_topology(tmp_path / "other.npz")


def test_the_real_bodies_legs_are_joined_by_flat_sheets(baked_bodies):
    topology = build_topology(build_super_body(baked_bodies, 6000))
    tube = skirt_body(topology, topology.rest.astype(np.float64))
    assert len(boundary_loops(topology.skirt_faces)) == 4
    for height in (-0.3, -0.5, -0.7):
        points, area = section(tube, topology.skirt_faces, height)
        assert area / ConvexHull(points).volume > 0.95


def test_skirts_and_dresses_have_the_second_topology():
    codes = topology_codes(np.arange(len(GARMENTS)))
    assert [g for g, c in zip(GARMENTS, codes, strict=True) if c] == ["Skirt", "Dress"]
