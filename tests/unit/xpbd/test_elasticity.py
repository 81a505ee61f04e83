from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from drapeline.geometry.mesh import edges, triangulate
from drapeline.outfits.fabrics import FABRICS
from drapeline.xpbd.elasticity import face_areas, make_hinges, make_springs, turn_hinges
from toys.sheets import Held, far_away, sheet, still

COTTON = FABRICS["cotton"]
COLUMNS = 5
EDGE_M = 0.02
QUADS = sheet(0.0, rows=3, columns=2).faces


def springs_of(piece, shrink=0.0):
    shares = np.full(len(piece.vertices), shrink)
    return make_springs(piece.vertices.astype(float), piece.faces, COTTON, shares)


def test_on_square_quads_an_edge_has_the_fabrics_stiffness_and_a_diagonal_half_of_it():
    piece = sheet(0.0, rows=5, edge_m=0.02)
    springs = springs_of(piece)
    count = len(edges(piece.faces))
    inner = springs.stiffness_n_m[:count] > 0.75 * COTTON.stretch_n_per_m
    assert springs.stiffness_n_m[:count][inner] == pytest.approx(COTTON.stretch_n_per_m, rel=1e-4)
    assert inner.sum() == count - 16  # those on the boundary have threads on one side only
    assert springs.stiffness_n_m[count:] == pytest.approx(COTTON.stretch_n_per_m / 2, rel=1e-4)
    assert springs.damping_kg_s[count:] == pytest.approx(COTTON.damping_kg_s / 2, rel=1e-4)


def test_elastics_shorten_springs():
    piece = sheet(0.0, rows=5)
    assert springs_of(piece, 0.2).lengths_m == pytest.approx(0.8 * springs_of(piece).lengths_m)


def test_areas_of_quads_and_triangles():
    piece = sheet(0.0, rows=4, columns=3, edge_m=0.02)
    points = piece.vertices.astype(float)
    assert face_areas(points, piece.faces) == pytest.approx(np.full(6, 4e-4))
    assert face_areas(points, triangulate(piece.faces)) == pytest.approx(np.full(12, 2e-4))


def bent_along(vertices, hinges):
    """Weighted sums (H, 3) of the vertices at hinges, and the hinges' unit normals (H, 3)."""
    sums = np.einsum("hk,hki->hi", hinges.weights, vertices[hinges.vertices])
    first, second, third, fourth = (vertices[hinges.vertices[:, k]] for k in range(4))
    normals = np.cross(second - first, fourth - third)
    return sums, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def bending_energy(vertices, hinges):
    sums, normals = bent_along(vertices, hinges)
    excess = (sums * normals).sum(axis=1) - hinges.lengths_m
    return (0.5 * hinges.stiffness_n_m * excess**2).sum()


def roll(flat, radius):
    """A level sheet rolled about the Y axis: upwards, or downwards if the radius is less than 0."""
    angle = flat[:, 0] / radius
    return np.stack([radius * np.sin(angle), flat[:, 1], radius * (1 - np.cos(angle))], axis=1)


@pytest.mark.parametrize("faces_of", [lambda faces: faces, triangulate])
@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.0])
def test_a_rolled_sheet_has_the_energy_of_its_curvature(faces_of, aspect):
    """Half of the bending stiffness times curvature squared, over the area."""
    piece = sheet(0.0, rows=41, columns=round(1 + 20 / aspect), edge_m=0.01)
    flat = piece.vertices * [1, aspect, 1]
    hinges = make_hinges(flat, faces_of(piece.faces), COTTON)
    assert bending_energy(flat, hinges) == pytest.approx(0, abs=1e-15)
    expected = 0.5 * COTTON.bending_n_m / 0.6**2 * 0.4 * 0.2
    assert bending_energy(roll(flat, 0.6), hinges) == pytest.approx(expected, rel=0.12)
    assert bending_energy(roll(flat, -0.6), hinges) == pytest.approx(expected, rel=0.12)


@pytest.mark.parametrize("faces_of", [lambda faces: faces, triangulate])
def test_a_sheet_that_is_made_curved_resists_being_bent_to_the_other_side(faces_of):
    piece = sheet(0.0, rows=21, edge_m=0.01)
    made = roll(piece.vertices.astype(float), 0.3)
    hinges = make_hinges(made, faces_of(piece.faces), COTTON)
    expected = 0.5 * COTTON.bending_n_m * (2 / 0.3) ** 2 * 0.2**2
    assert bending_energy(made, hinges) == pytest.approx(0, abs=1e-15)
    assert bending_energy(made * [1, 1, -1], hinges) == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize("faces_of", [lambda faces: faces, triangulate])
def test_hinges_push_along_their_normals_where_rows_turn_within_the_cloth(faces_of):
    """What does not push along the line of the weighted sum turns the cloth as a whole."""
    piece = sheet(0.0, rows=11, edge_m=0.02)
    x, y = piece.vertices[:, :2].astype(float).T
    angle, radius = x / 0.2, 0.3 + y
    fan = np.stack([radius * np.sin(angle), radius * np.cos(angle), 3 * x * x + y * y], axis=1)
    sums, normals = bent_along(fan, make_hinges(fan, faces_of(piece.faces), COTTON))
    aside = np.linalg.norm(np.cross(sums, normals), axis=1)
    assert aside.max() < 0.02 * np.linalg.norm(sums, axis=1).mean()


@pytest.mark.parametrize("share", [0.2, 1.5])
def test_a_strip_that_is_made_curved_upwards_sags_as_a_beam_does(run, share):
    """Of what makes it straight at its clamp, its own weight is a share there.

    Linear beam theory, for the hinges at the rows: the curvature is that at rest, less the moment
    over the bending stiffness.
    """
    length_m, curvature, rows = 0.12, 4.0, 7
    edge_m = length_m / (rows - 1)
    weight = COTTON.density_kg_m2 * 9.81
    stiff = weight * length_m**2 / 2 / curvature / share
    fabric = replace(COTTON, bending_n_m=stiff, stretch_n_per_m=1000, drag_kg_m2_s=3)
    held = np.zeros((rows + 1, COLUMNS), dtype=np.float32)
    held[:2] = 1  # the clamp is at the second row, where the strip is level
    piece = sheet(0.0, rows + 1, COLUMNS, edge_m)
    made = roll(piece.vertices - piece.vertices[COLUMNS], 1 / curvature).astype(np.float32)
    made[:COLUMNS, 2] = 0
    pins = Held(held.ravel(), made, still)
    piece = replace(piece, vertices=made, fabric=fabric, pins=pins)
    (moved,) = run([piece], 60, steps=40, path=far_away)
    arms = np.arange(1, rows) / (rows - 1)
    sag_m = share * curvature * length_m**2 * (arms**3).mean()
    tip = moved[:, -COLUMNS:, 2].mean(axis=1)
    assert tip[0] - tip[-1] == pytest.approx(sag_m, abs=0.002)


def test_hinges_leave_alone_what_moves_as_a_whole():
    piece = sheet(0.0, rows=6)
    for faces in (piece.faces, triangulate(piece.faces)):
        hinges = make_hinges(piece.vertices.astype(float), faces, COTTON)
        assert hinges.weights.sum(axis=1) == pytest.approx(np.zeros(len(hinges.weights)), abs=1e-9)


@pytest.mark.parametrize("triangles", [False, True])
@pytest.mark.parametrize(("edge_m", "steps"), [(0.01, 80), (0.02, 20)])
def test_a_hanging_strip_stretches_by_the_fabrics_stiffness(run, edge_m, steps, triangles):
    """As Blender's (`tests/unit/blender/test_fabric_units.py`): 1.5 times as stiff as a thread."""
    fabric = replace(FABRICS["silk"], drag_kg_m2_s=3, bending_n_m=1e-9)
    length_m = 0.2
    rows = 1 + round(length_m / edge_m)
    pin = np.zeros((rows, COLUMNS), dtype=np.float32)
    pin[0] = 1
    piece = sheet(1.0, rows, COLUMNS, edge_m, pin=pin.ravel(), fabric=fabric)
    if triangles:
        piece = replace(piece, faces=triangulate(piece.faces))
    (moved,) = run([piece], 60, steps=steps)
    height = moved[-1, :, 2]
    stretch_m = height[:COLUMNS].mean() - height[-COLUMNS:].mean() - length_m
    weight = fabric.density_kg_m2 * 9.81
    expected = weight * length_m**2 / 2 / (1.5 * fabric.stretch_n_per_m)
    assert stretch_m == pytest.approx(expected, rel=0.25)


@pytest.mark.parametrize("faces_of", [lambda faces: faces, triangulate])
def test_edges_without_length_give_finite_numbers(faces_of):
    piece = sheet(0.0, rows=5)
    points = piece.vertices.astype(float)
    points[5:10] = points[:5]
    points[16] = points[17]
    faces = faces_of(piece.faces)
    springs = make_springs(points, faces, COTTON, np.zeros(25))
    hinges = make_hinges(points, faces, COTTON)
    for found in (springs, hinges):
        for numbers in (found.lengths_m, found.stiffness_n_m, found.damping_kg_s):
            assert np.isfinite(numbers).all()
        assert (found.stiffness_n_m > 0).all()
    assert np.isfinite(hinges.weights).all()


def turn(place, turned, *, damping):
    """Two hinges of a sheet of three rows, turned once: vertices and how far they are bent then."""
    hinges = make_hinges(sheet(0.0, rows=3, columns=2, edge_m=EDGE_M).vertices, QUADS, COTTON)
    masses = (hinges.weights**2).sum(axis=1)
    ease = 1 / ((1 + damping) * masses + 100)
    numbers = np.stack([hinges.lengths_m, masses, np.full(2, damping), ease], axis=1)
    moved = wp.array(np.float32(np.column_stack([place, np.ones(6)])), dtype=wp.vec4)
    bent = wp.array(np.float32(turned), dtype=float)
    wp.launch(
        turn_hinges,
        dim=2,
        inputs=[
            wp.array(hinges.vertices.astype(np.int32), dtype=int),
            wp.array(hinges.weights.astype(np.float32), dtype=float),
            wp.array(numbers.astype(np.float32), dtype=float),
            0,
        ],
        outputs=[bent, moved],
    )
    return moved.numpy()[:, :3] - np.float32(place), bent.numpy()


def folded(degrees):
    """Three rows of which the outer two are turned up."""
    angle, side = np.radians(degrees), np.repeat([-1, 0, 1], 2)
    across = np.tile([-0.5, 0.5], 3)
    rise = np.abs(side) * np.sin(angle)
    return EDGE_M * np.stack([side * np.cos(angle), across, rise], axis=1)


def test_a_fold_that_goes_beyond_the_flat_one_is_not_thrown_open():
    """There the normal flips, which is no motion that damping could take away."""
    _, bent = turn(folded(89), np.zeros(2), damping=0)
    assert np.abs(bent) == pytest.approx(np.full(2, 2 * EDGE_M), rel=0.1)
    way, flipped = turn(folded(91), bent, damping=38)
    assert flipped == pytest.approx(-bent, rel=0.1)
    free, _ = turn(folded(91), bent, damping=0)
    assert (way[2:4, 2] > 0).all()  # the middle goes up, the others down: it opens
    assert (np.abs(way) <= np.abs(free) + 1e-9).all()


def test_damping_takes_away_how_far_a_hinge_was_bent_since_it_was_turned():
    _, bent = turn(folded(10), np.zeros(2), damping=0)
    bent = np.sign(bent) * 2 * EDGE_M * np.sin(np.radians(10))
    still, _ = turn(folded(10), bent, damping=38)
    bending, _ = turn(folded(10), np.zeros(2), damping=38)
    assert np.abs(still).max() > 3e-5
    # Along the cloth, the first hinge's way makes the second's normal lean.
    assert bending[:, 2] == pytest.approx(39 * still[:, 2], rel=0.05)
