"""The mesh hierarchy: counts, partitions, fields in one piece, segments that never mix."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from drapeline.errors import InputError
from drapeline.geometry.mesh import edges
from drapeline.registration.to_body.hierarchy import (
    LEVELS,
    POOLINGS,
    _Contraction,
    build_hierarchy,
    level_counts,
    load_hierarchy,
    save_hierarchy,
)
from drapeline.registration.to_body.segments import vertex_areas
from drapeline.registration.to_body.super_body import build_super_body
from drapeline.registration.to_body.topology import TOPOLOGIES, build_topology, skirt_body

COUNTS = (2000, 700, 250, 100, 56, 21)


@pytest.fixture(scope="module")
def topology(toy_body):
    noise = np.random.default_rng(0).normal(0, 5e-4, toy_body.v_template.shape)
    body = replace(toy_body, v_template=(toy_body.v_template + noise).astype("f4"))
    return build_topology(build_super_body({"female": body, "male": body}, COUNTS[0]))


@pytest.fixture(scope="module", params=POOLINGS)
def pooling(request):
    return request.param


@pytest.fixture(scope="module")
def hierarchy(topology, pooling):
    return build_hierarchy(topology, pooling, COUNTS)


def levels(hierarchy):
    """(topology's name, level, label of each of the body's vertices) below the body itself."""
    for name in TOPOLOGIES:
        for level in range(1, LEVELS):
            yield name, level, hierarchy.labels(name, level)


def faces_of(topology, name):
    return {"body": topology.faces, "skirt": topology.skirt_faces}[name]


def test_counts_are_the_papers_for_its_body_and_fall_evenly_for_others():
    assert level_counts(14475) == (14475, 3618, 904, 226, 56, 21)
    counts = level_counts(3600)
    assert (counts[0], counts[-2:]) == (3600, (56, 21))
    ratios = np.divide(counts[:-2], counts[1:-1])
    np.testing.assert_allclose(ratios, ratios.mean(), rtol=0.02)
    with pytest.raises(InputError, match="a body of 90 vertices, expected at least 112"):
        level_counts(90)


def test_every_level_is_a_partition_of_the_one_before(hierarchy):
    assert hierarchy.counts == COUNTS
    for name in TOPOLOGIES:
        for level, parent in enumerate(hierarchy.parents[name]):
            assert len(parent) == COUNTS[level]
            np.testing.assert_array_equal(np.unique(parent), np.arange(COUNTS[level + 1]))


def test_fields_are_in_one_piece(topology, hierarchy):
    for name, level, label in levels(hierarchy):
        pairs = edges(faces_of(topology, name))
        within = pairs[label[pairs[:, 0]] == label[pairs[:, 1]]]
        graph = csr_matrix((np.ones(len(within)), within.T), shape=(COUNTS[0],) * 2)
        assert connected_components(graph, directed=False)[0] == COUNTS[level]


def test_edges_are_those_between_fields(topology, hierarchy):
    for name, level, label in levels(hierarchy):
        pairs = label[edges(faces_of(topology, name))]
        expected = {(min(p), max(p)) for p in pairs.tolist() if p[0] != p[1]}
        found = hierarchy.edges[name][level]
        assert set(map(tuple, found.tolist())) == expected
        assert len(found) == len(expected)
    for name in TOPOLOGIES:
        np.testing.assert_array_equal(hierarchy.edges[name][0], edges(faces_of(topology, name)))


def test_a_field_is_stood_for_by_one_of_its_own_vertices(topology, hierarchy):
    places = {"body": topology.rest, "skirt": skirt_body(topology, topology.rest)}
    for name, level, label in levels(hierarchy):
        vertices = hierarchy.vertices[name][level]
        np.testing.assert_array_equal(label[vertices], np.arange(COUNTS[level]))
        np.testing.assert_allclose(
            hierarchy.positions[name][level], places[name][vertices], atol=1e-6
        )


def test_segments_never_mix_and_end_as_one_vertex_each(topology):
    hierarchy = build_hierarchy(topology, "segments", COUNTS)
    for name, level, label in levels(hierarchy):
        pairs = np.unique(np.stack([label, topology.segments], 1), axis=0)
        assert len(pairs) == COUNTS[level]  # each field knows one segment
        if level == LEVELS - 1:
            np.testing.assert_array_equal(label, topology.segments, err_msg=name)


def test_uniform_pooling_is_free_of_segments(topology):
    hierarchy = build_hierarchy(topology, "uniform", COUNTS)
    for name, level, label in levels(hierarchy):
        pairs = np.unique(np.stack([label, topology.segments], 1), axis=0)
        assert len(pairs) > 1.1 * COUNTS[level], name
    body, skirt = (hierarchy.labels(name, LEVELS - 1) for name in TOPOLOGIES)
    assert (body == skirt).mean() > 0.4  # numbered alike, though found independently


def test_fields_are_of_even_size(topology, hierarchy):
    places = {"body": topology.rest, "skirt": skirt_body(topology, topology.rest)}
    for name, level, label in levels(hierarchy):
        if level == LEVELS - 1:
            continue  # segments differ in size by design
        areas = vertex_areas(places[name].astype(np.float64), faces_of(topology, name))
        area = np.bincount(label, areas)
        assert area.std() / area.mean() < 0.5, (name, level)


def straddling(steepness):
    """Of a sheet with a fold along x = 0, how many of 30 fields reach over the fold."""
    x, y = np.meshgrid(np.linspace(-1, 1, 20), np.linspace(0, 1, 10), indexing="ij")
    places = np.stack([x.ravel(), y.ravel(), steepness * np.abs(x).ravel()], axis=1)
    index = np.arange(200).reshape(20, 10)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    work = _Contraction(places, faces, np.zeros(200, dtype=int))
    work.contract_to(30)
    label = work.level()[0]
    left, right = np.bincount(label, places[:, 0] < 0), np.bincount(label, places[:, 0] > 0)
    return ((left > 0) & (right > 0)).sum()


def test_fields_end_at_folds():
    assert straddling(0.0) >= 3
    assert straddling(1.0) == 0


def test_numbering_of_vertices_does_not_matter(topology, hierarchy, pooling):
    order = np.random.default_rng(4).permutation(COUNTS[0])  # new id -> old id
    new_id = np.argsort(order).astype(np.int32)
    turned = replace(
        topology,
        faces=new_id[topology.faces],
        skirt_faces=new_id[topology.skirt_faces],
        inner_leg=topology.inner_leg[order],
        segments=topology.segments[order],
        rest=topology.rest[order],
    )
    other = build_hierarchy(turned, pooling, COUNTS)
    for level in range(1, LEVELS):
        ours, theirs = hierarchy.labels("body", level)[order], other.labels("body", level)
        assert len(np.unique(np.stack([ours, theirs], 1), axis=0)) == COUNTS[level]


def test_a_saved_hierarchy_loads_as_it_was(hierarchy, tmp_path):
    save_hierarchy(tmp_path / "h.npz", hierarchy)
    loaded = load_hierarchy(tmp_path / "h.npz")
    assert loaded.counts == hierarchy.counts
    for what in ("parents", "edges", "positions", "vertices"):
        for name in TOPOLOGIES:
            ours, theirs = getattr(hierarchy, what)[name], getattr(loaded, what)[name]
            assert len(ours) == len(theirs) == LEVELS - (what == "parents")
            for a, b in zip(ours, theirs, strict=True):
                np.testing.assert_array_equal(a, b)
                assert a.dtype == b.dtype
    with np.load(tmp_path / "h.npz") as archive:
        assert archive["skirt/parent_4"].shape == (56,)
        assert archive["body/edges_5"].shape[1] == 2


def test_wrong_requests_are_refused(topology):
    with pytest.raises(ValueError, match="pooling 'max', expected segments or uniform"):
        build_hierarchy(topology, "max", COUNTS)
    for counts in [(1999, 700, 250, 100, 56, 21), (2000, 700, 700, 100, 56, 21), (2000, 700, 20)]:
        with pytest.raises(ValueError, match="expected to fall from 2000 to 21"):
            build_hierarchy(topology, "segments", counts)
