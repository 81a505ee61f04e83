"""Springs and hinges in lanes against those in turn, which a GPU solves."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from drapeline.geometry.lanes import LaneFloats, LaneInts, lay_in_lanes
from drapeline.geometry.mesh import triangulate
from drapeline.geometry.warp_mesh import start_warp
from drapeline.outfits.fabrics import FABRICS
from drapeline.seeding import rng_for
from drapeline.xpbd.elasticity import hinge_numbers, pull_springs, spring_numbers, turn_hinges
from drapeline.xpbd.lanes import pull_springs_in_lanes, turn_hinges_in_lanes
from drapeline.xpbd.system import join_garments
from toys.sheets import sheet

STEP_S = 1 / 30 / 42


@pytest.fixture(params=[False, True])
def cloth(request):
    """A crumpled sheet, some of whose rows have empty lanes: its system, places and masses."""
    start_warp()
    piece = sheet(0.0, rows=7, columns=5, fabric=replace(FABRICS["cotton"], bending_warp_n_m=1e-3))
    if request.param:
        piece = replace(piece, faces=triangulate(piece.faces))
    system = join_garments([piece])
    assert (system.spring_lanes < 0).any()
    assert (system.hinge_lanes < 0).any()
    crumpled = system.vertices + rng_for(1, "crumpled").normal(0, 0.003, system.vertices.shape)
    return system, np.column_stack([crumpled, system.inverse_masses]).astype(np.float32)


def numbers(values, lanes):
    return laid(values.astype(np.float32), lanes, float, LaneFloats)


def indices(values, lanes):
    return laid(values.astype(np.int32), lanes, int, LaneInts)


def laid(values, lanes, dtype, lane_dtype):
    """One array for each constraint in turn, and one for rows of lanes."""
    return wp.array(values, dtype=dtype), wp.array(lay_in_lanes(values, lanes), dtype=lane_dtype)


def both(kernels, count, lanes, inputs, states, weighed, launches):
    """What is left of states and vertices by both kernels, after launches with these numbers."""
    ends = []
    for k, (kernel, dim) in enumerate(zip(kernels, (count, len(lanes)), strict=True)):
        fixed, state = [pair[k] for pair in inputs], [pair[k].flatten() for pair in states]
        moved = wp.array(weighed, dtype=wp.vec4)
        for extra in launches:
            wp.launch(kernel, dim=dim, inputs=[*fixed, 0, *extra], outputs=[*state, moved])
        ends.append((*(values.numpy() for values in state), moved.numpy()))
    *in_turn, one = ends[0]
    *in_lanes, two = ends[1]
    full = lanes >= 0
    assert np.abs(one - weighed)[:, :3].max() > 1e-4
    np.testing.assert_array_equal(two[:, 3], weighed[:, 3])
    np.testing.assert_allclose(two, one, rtol=1e-5, atol=1e-6)
    for values, rows in zip(in_turn, in_lanes, strict=True):
        size = np.abs(values).max()  # a pull is a few millionths
        assert size > 0
        np.testing.assert_allclose(rows[full], values[lanes[full]], atol=1e-3 * size)


@pytest.mark.processor_only
def test_springs_in_lanes_are_those_in_turn(cloth):
    system, weighed = cloth
    springs, lanes = system.springs, system.spring_lanes
    factors = spring_numbers(springs, system.inverse_masses, STEP_S)
    inputs = [indices(springs.pairs, lanes), numbers(factors, lanes)]
    count = len(springs.pairs)
    states = [numbers(np.zeros((count, 1)), lanes), numbers(springs.lengths_m[:, None], lanes)]
    launches = [(1, 0, 1.0), (0, 0, 1.2), (0, 1, 1.4), (1, 0, 1.0)]
    both((pull_springs, pull_springs_in_lanes), count, lanes, inputs, states, weighed, launches)


@pytest.mark.processor_only
def test_hinges_in_lanes_are_those_in_turn(cloth):
    system, weighed = cloth
    hinges, lanes = system.hinges, system.hinge_lanes
    factors = hinge_numbers(hinges, system.inverse_masses, STEP_S)
    inputs = [
        *(indices(hinges.vertices, lanes), numbers(hinges.weights, lanes)),
        numbers(factors, lanes),
    ]
    sums = np.einsum("hk,hki->hi", hinges.weights, weighed[hinges.vertices, :3])
    # Bent so far to the other side before that the normal has flipped, or not bent at all.
    bent = np.linalg.norm(sums, axis=1)[:, None] * rng_for(2, "bent").choice(
        [-9, 0, 9], (len(sums), 1)
    )
    states = [numbers(bent, lanes)]
    kernels = turn_hinges, turn_hinges_in_lanes
    both(kernels, len(bent), lanes, inputs, states, weighed, [(), ()])
