from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from drapeline.geometry.mesh import edges, triangulate
from drapeline.outfits.fabrics import FABRICS
from drapeline.xpbd import elasticity
from drapeline.xpbd.elasticity import Hinges, face_areas, turn_hinges
from drapeline.xpbd.threads import warp_directions
from toys.sheets import Held, far_away, sheet, still

COTTON = FABRICS["cotton"]
COLUMNS = 5
EDGE_M = 0.02
QUADS = sheet(0.0, rows=3, columns=2).faces


FABRIC = replace(COTTON, shear_n_per_m=30)
STRETCH = {"warp": FABRIC.stretch_warp_n_per_m, "weft": FABRIC.stretch_weft_n_per_m}
# Bent alike along both threads, for sheets that are made curved: their warp is along the tube.
EVEN = replace(COTTON, bending_weft_n_m=COTTON.bending_warp_n_m)
FACES = pytest.mark.parametrize("faces_of", [lambda faces: faces, triangulate])


def make_springs(points, faces, fabric, shrink):
    return elasticity.make_springs(points, faces, fabric, shrink, warp_directions(points, faces))


def make_hinges(points, faces, fabric, stiffness=None):
    stiffness = np.ones(len(points)) if stiffness is None else stiffness
    return elasticity.make_hinges(points, faces, fabric, warp_directions(points, faces), stiffness)


def springs_of(piece, shrink=0.0):
    shares = np.full(len(piece.vertices), shrink)
    return make_springs(piece.vertices.astype(float), piece.faces, FABRIC, shares)


def stretching_energy(points, springs):
    ways = points[springs.pairs[:, 0]] - points[springs.pairs[:, 1]]
    longer = np.linalg.norm(ways, axis=1) - springs.lengths_m
    stiffness = np.where(longer > 0, springs.stiffness_n_m, springs.pushed_n_m)
    return (0.5 * stiffness * longer**2).sum()


@FACES
@pytest.mark.parametrize("aspect", [0.7, 1.0, 1.4])
@pytest.mark.parametrize(("axis", "thread"), [(0, "warp"), (1, "weft")])
def test_a_stretched_sheet_has_the_energy_of_its_threads(faces_of, aspect, axis, thread):
    """Half of the stiffness times strain squared, over the area; warp is along the X axis."""
    piece = sheet(0.0, rows=21, edge_m=0.01)
    flat = piece.vertices.astype(float) * [1, aspect, 1]
    springs = make_springs(flat, faces_of(piece.faces), FABRIC, np.zeros(len(flat)))
    stretched = flat.copy()
    stretched[:, axis] *= 1.01
    expected = 0.5 * STRETCH[thread] * 0.01**2 * 0.2**2 * aspect
    assert stretching_energy(stretched, springs) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("preset", ["cotton", "jersey", "leather", "blender_denim"])
@pytest.mark.parametrize("aspect", [0.7, 1.0, 1.4])
@pytest.mark.parametrize("way", [-1, 1])
def test_a_sheared_sheet_has_the_energy_of_its_angle(preset, aspect, way):
    fabric = FABRICS[preset]
    piece = sheet(0.0, rows=21, edge_m=0.01)
    flat = piece.vertices.astype(float) * [1, aspect, 1]
    springs = make_springs(flat, piece.faces, fabric, np.zeros(len(flat)))
    sheared = flat.copy()
    sheared[:, 0] += way * 0.002 * flat[:, 1]
    expected = 0.5 * fabric.shear_n_per_m * 0.002**2 * 0.2**2 * aspect
    assert stretching_energy(sheared, springs) == pytest.approx(expected, rel=0.05)


def test_blenders_presets_have_diagonals_half_as_stiff_as_edges_which_resist_both_ways():
    piece = sheet(0.0, rows=5, edge_m=0.02)
    flat = piece.vertices.astype(float)
    springs = make_springs(flat, piece.faces, FABRICS["blender_cotton"], np.zeros(25))
    count = len(edges(piece.faces))
    inner = springs.stiffness_n_m[:count] > 100
    assert springs.stiffness_n_m[:count][inner] == pytest.approx(135, rel=1e-4)
    assert inner.sum() == count - 16  # those on the boundary have threads on one side only
    assert springs.stiffness_n_m[count:] == pytest.approx(135 / 2, rel=1e-4)
    assert springs.pushed_n_m == pytest.approx(springs.stiffness_n_m)
    assert springs.damping_kg_s / springs.stiffness_n_m == pytest.approx(0.015 / 202.5, rel=1e-4)


def test_elastics_shorten_springs_and_are_softer_than_cloth():
    piece = sheet(0.0, rows=5)
    gathered, free = springs_of(piece, 0.2), springs_of(piece)
    assert gathered.lengths_m == pytest.approx(0.8 * free.lengths_m)
    assert (gathered.stiffness_n_m <= free.stiffness_n_m).all()
    assert gathered.stiffness_n_m.max() < 0.1 * free.stiffness_n_m.max()


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


@FACES
@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.0])
def test_a_rolled_sheet_has_the_energy_of_its_curvature(faces_of, aspect):
    """Half of the bending stiffness times curvature squared, over the area."""
    piece = sheet(0.0, rows=41, columns=round(1 + 20 / aspect), edge_m=0.01)
    flat = piece.vertices * [1, aspect, 1]
    hinges = make_hinges(flat, faces_of(piece.faces), COTTON)
    assert bending_energy(flat, hinges) == pytest.approx(0, abs=1e-15)
    expected = 0.5 * COTTON.bending_warp_n_m / 0.6**2 * 0.4 * 0.2
    assert bending_energy(roll(flat, 0.6), hinges) == pytest.approx(expected, rel=0.12)
    assert bending_energy(roll(flat, -0.6), hinges) == pytest.approx(expected, rel=0.12)


@FACES
def test_a_band_is_as_many_times_as_stiff_as_it_is_told(faces_of):
    piece = sheet(0.0, rows=21, edge_m=0.01)
    flat = piece.vertices.astype(float)
    faces = faces_of(piece.faces)
    rolled = roll(flat, 0.6)
    plain = bending_energy(rolled, make_hinges(flat, faces, COTTON))
    band = np.full(len(flat), 7.0)
    assert bending_energy(rolled, make_hinges(flat, faces, COTTON, band)) == pytest.approx(
        7 * plain
    )
    band[flat[:, 1] > 0] = 1
    half = bending_energy(rolled, make_hinges(flat, faces, COTTON, band))
    assert half == pytest.approx(4 * plain, rel=0.1)


@FACES
@pytest.mark.parametrize(("edge_m", "rows"), [(0.01, 41), (0.02, 21)])
def test_a_sheet_that_is_rolled_across_bends_its_weft(faces_of, edge_m, rows):
    piece = sheet(0.0, rows=rows, edge_m=edge_m)
    flat = piece.vertices.astype(float)
    hinges = make_hinges(flat, faces_of(piece.faces), COTTON)
    rolled = roll(flat[:, [1, 0, 2]], 0.6)[:, [1, 0, 2]]
    expected = 0.5 * COTTON.bending_weft_n_m / 0.6**2 * 0.4**2
    assert bending_energy(rolled, hinges) == pytest.approx(expected, rel=0.12)


@pytest.mark.parametrize("turn_deg", [30, 45])
def test_quads_are_as_stiff_on_the_bias_as_between_warp_and_weft(turn_deg):
    piece = sheet(0.0, rows=41, edge_m=0.01)
    flat = piece.vertices.astype(float)
    hinges = make_hinges(flat, piece.faces, COTTON)
    angle = np.radians(turn_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0]])
    turn = np.vstack([turn, [0, 0, 1]])
    rolled = roll(flat @ turn.T, 0.6) @ turn
    low, high = (
        0.5 * stiff / 0.6**2 * 0.4**2
        for stiff in (COTTON.bending_weft_n_m, COTTON.bending_warp_n_m)
    )
    assert 0.93 * low < bending_energy(rolled, hinges) < 1.05 * high


@FACES
def test_a_sheet_that_is_made_curved_resists_being_bent_to_the_other_side(faces_of):
    piece = sheet(0.0, rows=21, edge_m=0.01)
    made = roll(piece.vertices.astype(float), 0.3)
    hinges = make_hinges(made, faces_of(piece.faces), EVEN)
    expected = 0.5 * COTTON.bending_warp_n_m * (2 / 0.3) ** 2 * 0.2**2
    assert bending_energy(made, hinges) == pytest.approx(0, abs=1e-15)
    assert bending_energy(made * [1, 1, -1], hinges) == pytest.approx(expected, rel=0.15)


@FACES
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
    fabric = replace(COTTON, bending_warp_n_m=stiff, bending_weft_n_m=stiff, drag_kg_m2_s=3)
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
    soft = {"stretch_warp_n_per_m": 67.5, "stretch_weft_n_per_m": 60, "shear_n_per_m": 20}
    fabric = replace(FABRICS["blender_silk"], drag_kg_m2_s=3, bending_warp_n_m=1e-9, **soft)
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
    expected = weight * length_m**2 / 2 / fabric.stretch_warp_n_per_m
    assert stretch_m == pytest.approx(expected, rel=0.25)


@FACES
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
    # Without those that twist.
    hinges = Hinges(**{name: values[:2] for name, values in vars(hinges).items()})
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


def chord_angle(length_m, bending_length_m):
    """Radians below the level of the end of a strip that is clamped level: the heavy elastica.

    Curvature times the cube of the bending length is the moment of what lies beyond.
    """

    def slopes(way, state):
        angle, curvature, _, _ = state
        beyond = length_m - way
        return [curvature, -beyond * np.cos(angle) / bending_length_m**3, *turn_ahead(angle)]

    def turn_ahead(angle):
        return np.cos(angle), np.sin(angle)

    def end(curvature):
        return solve_ivp(slopes, (0, length_m), [0, curvature, 0, 0], rtol=1e-8).y[:, -1]

    most = length_m**2 / bending_length_m**3
    _, _, ahead, below = end(brentq(lambda curvature: end(curvature)[1], 0, most))
    return np.arctan2(below, ahead)


def test_the_heavy_elastica_is_peirces_at_the_angle_of_the_cantilever_test():
    assert np.degrees(chord_angle(0.1, 0.05)) == pytest.approx(41.5, abs=1.5)


@FACES
@pytest.mark.parametrize("edge_m", [0.01, 0.02])
@pytest.mark.parametrize("bending_n_m", [1e-5, 4.5e-4])
def test_a_cantilever_sinks_by_its_bending_length(run, faces_of, edge_m, bending_n_m):
    """ASTM D1388: at twice the bending length the end is 41.5 degrees below the clamp.

    The hinges at the clamp bend the cloth for half an edge to both sides: there the strip begins.
    """
    length_m = 0.1
    whole_m = length_m + edge_m / 2
    density = bending_n_m / 9.81 / (whole_m / 2) ** 3
    fabric = replace(
        COTTON, density_kg_m2=density, bending_warp_n_m=bending_n_m, drag_kg_m2_s=10 * density
    )
    held, columns = 4, 9  # pins give way, and there are fewer hinges at the sides of triangles
    rows = held + round(length_m / edge_m)
    pin = np.zeros((rows, columns), dtype=np.float32)
    pin[:held] = 1
    piece = sheet(1.0, rows, columns, edge_m, pin=pin.ravel(), fabric=fabric)
    piece = replace(piece, faces=faces_of(piece.faces))
    (moved,) = run([piece], 60, steps=14, path=far_away)
    by_row = moved[-1].reshape(rows, columns, 3).mean(axis=1)
    clamp, end = by_row[held - 1], by_row[-1]
    ahead, _, down = end - clamp
    found = np.degrees(np.arctan2(-down, ahead + edge_m / 2))
    assert found == pytest.approx(np.degrees(chord_angle(whole_m, whole_m / 2)), abs=5)
