"""The segments of the body."""

import numpy as np

from drapeline.geometry.mesh import edges
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
)
from toys.topology import piece_count


def test_twenty_one_segments_each_in_one_piece_in_both_topologies(made):
    _, topology = made
    np.testing.assert_array_equal(np.unique(topology.segments), np.arange(SEGMENTS))
    for faces in (topology.faces, topology.skirt_faces):
        pairs = edges(faces)
        for segment in range(SEGMENTS):
            inside = topology.segments == segment
            within = pairs[inside[pairs].all(axis=1)]
            assert piece_count(within, len(inside)) == 1 + (~inside).sum()


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
