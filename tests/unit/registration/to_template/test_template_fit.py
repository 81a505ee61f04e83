"""Garments brought to a template's topology, on shapes whose answer is known."""

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.geometry.mesh import boundary_loops, half_edges
from drapeline.registration.settings import TemplateFitSettings
from drapeline.registration.to_template.garment_template import named_loops
from drapeline.registration.to_template.remesh import remesh, remesh_table, residual
from drapeline.registration.to_template.template_fit import (
    Equation3,
    FitTarget,
    fit_to_template,
    front_strip,
)
from toys.templates import round_skirt


def slit(vertices, triangles, chosen, gap=0.012):
    """Part the tube at angle -90 degrees where `chosen` says so of a column's heights."""
    angle = np.arctan2(vertices[:, 1], vertices[:, 0])
    column = np.flatnonzero((np.abs(angle + np.pi / 2) < 1e-6) & chosen(vertices[:, 2]))
    copies = len(vertices) + np.arange(len(column))
    swap = np.arange(len(vertices) + len(column))
    swap[column] = copies
    left = vertices[triangles].mean(axis=1)[:, 0] > 0
    cut = np.where(left[:, None], swap[triangles], triangles)
    points = np.concatenate([vertices, vertices[column]])
    points[column, 0] -= gap / 2
    points[copies, 0] += gap / 2
    return points, cut


@pytest.mark.parametrize("front", ["open", "polo"])
@pytest.mark.parametrize(("gap", "rows"), [(0.004, 25), (0.02, 25), (0.03, 25), (0.02, 12)])
def test_an_open_front_is_closed(front, gap, rows):
    vertices, triangles = round_skirt(around=40, rows=rows)
    top = 0.1 if front == "open" else -0.3
    points, cut = slit(vertices, triangles, lambda z: z > -9 if front == "open" else z > top, gap)
    assert len(boundary_loops(cut)) == (1 if front == "open" else 2)
    closed = np.concatenate([cut, front_strip(points, cut)])
    loops = boundary_loops(closed)
    assert len(loops) == 2
    for loop in loops:  # nothing of hem and neck is sewn up
        assert np.ptp(points[loop, 2]) < 0.025
        assert len(loop) >= 40
    _, uses = np.unique(half_edges(closed), axis=0, return_counts=True)
    assert uses.max() == 1


def test_a_closed_front_needs_no_strip():
    vertices, triangles = round_skirt(radius=0.1)
    assert len(front_strip(vertices, triangles)) == 0


def test_a_template_fits_onto_itself(template):
    fit = fit_to_template(
        template.vertices, template.faces, template, TemplateFitSettings(iterations=0)
    )
    table = remesh_table(fit)
    np.testing.assert_allclose(remesh(template.vertices, table), template.vertices, atol=2e-3)
    assert residual(template.vertices, template.faces, template, table).flipped_faces == 0


@pytest.mark.parametrize(
    "source",
    [
        {"radius": 0.26, "low": -0.35, "around": 40, "rows": 13},
        {"radius": 0.15, "low": -0.9, "high": 0.08, "around": 30, "rows": 40, "flare": 0.8},
        {"radius": 0.2, "low": -0.2, "around": 20, "rows": 6},
    ],
    ids=["short and wide", "long and flared", "coarse mini"],
)
def test_a_skirt_keeps_its_surface_ends_and_sides(template, source):
    vertices, triangles = round_skirt(**source)
    table = remesh_table(fit_to_template(vertices, triangles, template))
    new = remesh(vertices, table)
    found = residual(vertices, triangles, template, table)
    # Chords of the two polygons around lie this far within a circle.
    radius_mm = 1000 * np.hypot(vertices[:, 0], vertices[:, 1]).max()
    chord_mm = radius_mm * (2 - np.cos(np.pi / 24) - np.cos(np.pi / source["around"]))
    assert found.original_to_remeshed_mm < chord_mm
    assert found.remeshed_to_original_mm < chord_mm
    assert found.flipped_faces == 0
    waist, hem = (new[template.loop == k] for k in range(2))
    np.testing.assert_allclose(waist[:, 2], vertices[:, 2].max(), atol=1e-6)
    np.testing.assert_allclose(hem[:, 2], vertices[:, 2].min(), atol=1e-6)
    turn = np.angle(new[:, 0] + 1j * new[:, 1]) - np.angle(
        template.vertices[:, 0] + 1j * template.vertices[:, 1]
    )
    assert np.abs((turn + np.pi) % (2 * np.pi) - np.pi).max() < 0.12
    share = (new[:, 2] - new[:, 2].min()) / np.ptp(new[:, 2])
    expected = (template.vertices[:, 2] + 0.5) / 0.5
    np.testing.assert_allclose(share, expected, atol=0.12)


def test_the_numbering_of_the_source_does_not_matter(template):
    vertices, triangles = round_skirt(radius=0.23, around=36, rows=15)
    order = np.random.default_rng(0).permutation(len(vertices))
    shuffled, back = vertices[order], np.argsort(order)
    settings = TemplateFitSettings(iterations=5)
    first, second = (
        remesh(v, remesh_table(fit_to_template(v, f, template, settings)))
        for v, f in ((vertices, triangles), (shuffled, back[triangles][::-1]))
    )
    np.testing.assert_allclose(first, second, atol=2e-3)


def test_a_garment_without_an_opening_is_refused(template):
    vertices, triangles = round_skirt()
    top = len(vertices)
    waist = boundary_loops(triangles)[1]
    lid = np.stack([np.roll(waist, -1), waist, np.full(len(waist), top)], axis=1)
    closed = np.concatenate([triangles, lid])
    with pytest.raises(InputError, match="the garment has no hem, expected the openings waist"):
        fit_to_template(np.concatenate([vertices, [[0, 0, 0.05]]]), closed, template)


# Equation 3


@pytest.fixture(scope="module")
def crooked(template):
    vertices, triangles = round_skirt(radius=0.22, around=14, rows=6)
    loops = named_loops(vertices, boundary_loops(triangles), template.loop_names)
    vertices = vertices + np.random.default_rng(4).normal(0, 0.01, vertices.shape)
    return vertices, triangles, loops


def only(term, value=1.0):
    return TemplateFitSettings(
        **{
            name: value if name == term else 0.0
            for name in ("chamfer", "edge", "normal", "boundary")
        }
    )


@pytest.mark.parametrize("term", ["chamfer", "edge", "normal", "boundary"])
def test_the_gradient_is_that_of_differences(template, crooked, term):
    vertices, triangles, loops = crooked
    equation = Equation3(triangles, loops, FitTarget(template), only(term))
    _, gradient = equation(vertices)
    rng = np.random.default_rng(0)
    for _ in range(5):
        way = rng.normal(0, 1, vertices.shape)
        step = 1e-7
        slope = (equation(vertices + step * way)[0] - equation(vertices - step * way)[0]) / (
            2 * step
        )
        assert (gradient * way).sum() == pytest.approx(slope, rel=2e-4, abs=1e-7)


def test_chamfer_terms_are_those_of_all_pairs(template, crooked):
    vertices, triangles, loops = crooked
    target = FitTarget(template)

    def both_ways(a, b):
        squared = ((a[:, None] - b) ** 2).sum(-1)
        return squared.min(1).mean() + squared.min(0).mean()

    value, _ = Equation3(triangles, loops, target, only("chamfer"))(vertices)
    assert value == pytest.approx(both_ways(vertices, target.points))
    value, _ = Equation3(triangles, loops, target, only("boundary", 3.0))(vertices)
    expected = np.mean(
        [both_ways(vertices[loops[name]], target.boundaries[name]) for name in loops]
    )
    assert value == pytest.approx(3 * expected)


def test_edge_and_normal_terms_of_shapes_that_are_known(template):
    target, fold = FitTarget(template), np.array([[0, 1, 2], [1, 0, 3]])
    right = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, 0, 1]])
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0]])
    loops = {"waist": np.arange(4)}
    normal = Equation3(fold, loops, target, only("normal"))
    assert normal(right)[0] == pytest.approx(1)
    assert normal(flat)[0] == pytest.approx(0)
    lengths = np.array([1, *[np.sqrt(1.25)] * 4])
    assert Equation3(fold, loops, target, only("edge"))(flat)[0] == pytest.approx(lengths.var())


def test_minimising_lowers_equation_3(template, crooked):
    vertices, triangles, loops = crooked
    equation = Equation3(triangles, loops, FitTarget(template), TemplateFitSettings())
    assert equation(equation.minimise(vertices))[0] < 0.5 * equation(vertices)[0]
