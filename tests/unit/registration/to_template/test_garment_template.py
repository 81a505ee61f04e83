"""Templates in their files, and which of their openings is which."""

from itertools import permutations

import numpy as np
import pytest

from drapeline.bodies.rest_body import rest_body
from drapeline.errors import InputError
from drapeline.geometry.closest import closest_points
from drapeline.geometry.mesh import Mesh, boundary_loops, edges, face_normals, triangulate
from drapeline.geometry.obj import save_obj
from drapeline.outfits.garment_types import GARMENT4D_TYPES, GARMENT_TYPES, GARMENTS
from drapeline.outfits.generate import sample_outfit
from drapeline.outfits.templates import build_templates
from drapeline.registration.settings import TemplateFitSettings
from drapeline.registration.to_template.garment_template import (
    LOOP_NAMES,
    load_template,
    make_template,
    named_loops,
    template_from_mesh,
)
from drapeline.registration.to_template.remesh import remesh, remesh_table, residual
from drapeline.registration.to_template.template_fit import FitTarget, fit_to_template
from drapeline.seeding import rng_for
from toys.templates import toy_template
from toys.tiny_sample import tube


def test_a_template_survives_its_file(tmp_path):
    template = toy_template()
    template.save(tmp_path / "t.npz")
    loaded = load_template(tmp_path / "t.npz")
    for name in ("vertices", "faces", "loop"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(template, name))
    assert loaded.loop_names == template.loop_names


def test_a_file_without_its_openings_is_refused(tmp_path):
    np.savez(tmp_path / "t.npz", vertices=np.zeros((3, 3)), faces=np.array([[0, 1, 2]]))
    with pytest.raises(InputError, match=r"t\.npz.*loop"):
        load_template(tmp_path / "t.npz")


# Where the middles of a type's openings are, in a rest pose with arms and legs apart.
_SHIRT = {
    "neck": (0, 0, 0.5),
    "hem": (0, 0, -0.1),
    "left_cuff": (0.4, 0, 0.3),
    "right_cuff": (-0.4, 0, 0.3),
}
_ARMHOLES = {"left_cuff": (0.17, 0, 0.4), "right_cuff": (-0.17, 0, 0.4)}
PLACES = {
    "Skirt": {"waist": (0, 0, 0), "hem": (0, 0, -0.5)},
    "Tshirt": _SHIRT,
    "Top": {**_SHIRT, **_ARMHOLES},
    "Dress": {**_SHIRT, "hem": (0, 0, -0.7)},
    "Trousers": {"waist": (0, 0, 0), "left_leg": (0.3, 0, -0.9), "right_leg": (-0.3, 0, -0.9)},
    # Legs that end further to the sides than its armholes.
    "Jumpsuit": {
        "neck": (0, 0, 0.5),
        **_ARMHOLES,
        "left_leg": (0.3, 0, -0.9),
        "right_leg": (-0.3, 0, -0.9),
    },
    "Jacket": {
        "edge": (0, -0.1, 0.2),
        "left_cuff": (0.4, 0, 0.3),
        "right_cuff": (-0.4, 0, 0.3),
    },
}


@pytest.mark.parametrize("garment", PLACES)
def test_openings_are_told_apart_in_whatever_order_they_come(garment):
    places = PLACES[garment]
    points = np.array([*places.values()], dtype=float)
    loops = [np.array([index]) for index in range(len(points))]
    for order in permutations(loops):
        found = named_loops(points, list(order), LOOP_NAMES[garment])
        assert list(found) == list(LOOP_NAMES[garment])
        assert {name: ids.tolist() for name, ids in found.items()} == {
            name: [index] for index, name in enumerate(places)
        }


def test_the_edge_of_a_jacket_is_the_longest_of_what_are_no_cuffs():
    middles = [[0, -0.1, 0.2], [0.4, 0, 0.3], [-0.4, 0, 0.3], [0.1, -0.1, 0.0], [0.1, -0.1, 0.4]]
    points = np.repeat(np.array(middles), [6, 9, 9, 3, 5], axis=0)
    loops = np.split(np.arange(len(points)), [6, 15, 24, 27])
    for order in permutations(loops):
        found = named_loops(points, list(order), LOOP_NAMES["Jacket"])
        assert list(found) == ["edge", "left_cuff", "right_cuff"]
        for name, expected in zip(found, loops, strict=False):
            np.testing.assert_array_equal(found[name], expected)


def test_openings_that_are_missing_are_left_out():
    points = np.array([[0, 0, 1.0], [0, 0, 0]])
    assert named_loops(points, [np.array([0])], ("waist", "hem")) == {"waist": np.array([0])}
    found = named_loops(points, [np.array([1]), np.array([0])], ("waist", "hem"))
    assert {name: ids.tolist() for name, ids in found.items()} == {"waist": [0], "hem": [1]}


@pytest.fixture(scope="module")
def dress_forms(toy_body):
    return {"female": build_templates(toy_body)}


@pytest.fixture(scope="module")
def made(toy_body, dress_forms):
    bodies = {"female": toy_body}
    return {name: make_template(name, dress_forms, bodies, 0.035) for name in GARMENTS}


def middles(template):
    """Of its openings, by name."""
    return {
        name: template.vertices[template.loop == k].mean(axis=0)
        for k, name in enumerate(template.loop_names)
    }


@pytest.mark.parametrize("garment", GARMENTS)
def test_a_template_has_the_openings_of_its_type(made, garment):
    template = made[garment]
    loops = boundary_loops(template.faces)
    assert template.loop_names == LOOP_NAMES[garment]
    assert len(loops) == len(template.loop_names)
    for loop in loops:
        assert len(set(template.loop[loop].tolist())) == 1
        assert template.loop[loop[0]] >= 0
    assert (template.loop >= 0).sum() == sum(map(len, loops))
    middle = middles(template)
    top = middle.get("neck", middle.get("waist"))
    if top is not None:
        for name in {"hem", "left_leg"} & middle.keys():
            assert top[2] > middle[name][2] + 0.2
    for kind in ("cuff", "leg"):
        if f"left_{kind}" in middle:
            left, right = (middle[f"{side}_{kind}"] for side in ("left", "right"))
            np.testing.assert_allclose(left, right * [-1, 1, 1], atol=0.02)
            assert left[0] > 0.05


@pytest.mark.parametrize("garment", ["Tshirt", "Top", "Trousers", "Skirt", "Jumpsuit", "Dress"])
def test_a_template_has_sleeves_where_garments_of_its_type_can(made, garment):
    sleeved = FitTarget(made[garment]).sleeved
    assert sleeved == (GARMENT_TYPES[garment].sleeve_chance > 0)


def test_a_jacket_is_open_in_front_from_hem_to_neck(made):
    template = made["Jacket"]
    edge = template.vertices[template.loop == LOOP_NAMES["Jacket"].index("edge")]
    height = template.vertices[:, 2]
    assert edge[:, 2].min() == height.min()
    assert edge[:, 2].max() > height.max() - 0.05
    # Along the front it comes by at every height, on both sides.
    for side in (-1, 1):
        front = edge[(side * edge[:, 0] > 0) & (edge[:, 1] < -0.05)]
        assert np.diff(np.sort(front[:, 2])).max() < 0.06
        assert np.ptp(front[:, 2]) > 0.35


@pytest.mark.parametrize("garment", GARMENTS)
def test_a_template_lies_about_the_mean_body(made, garment, toy_body):
    template = made[garment]
    pairs = edges(template.faces)
    ends = template.vertices[pairs]
    assert 0.025 < np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean() < 0.05
    assert len(np.unique(template.faces)) == len(template.vertices)
    rest = rest_body(toy_body, np.zeros(10))
    low, high = rest.min(axis=0) - 0.25, rest.max(axis=0) + 0.25
    assert ((template.vertices > low) & (template.vertices < high)).all()
    normals = face_normals(template.vertices.astype(float), template.faces)
    away = template.vertices[template.faces].mean(axis=1) - rest.mean(axis=0)
    assert (normals[:, :2] * away[:, :2]).sum(axis=1).mean() > 0


def worn(toy_body, dress_forms, kind, seed):
    """Garments of the generator."""
    outfit = sample_outfit(
        rng_for(seed, "worn"),
        dress_forms["female"],
        toy_body,
        gender="female",
        shape=rng_for(seed, "shape").uniform(-1, 1, 10),
        outfit_type=kind,
        edge_length_m=0.035,
    )
    return outfit.garments


@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        *(("Tshirt+Trousers", 0), ("Top+Skirt", 1), ("Tshirt+Trousers+Jacket", 2)),
        # Of the two, the first has sleeves.
        *(("Jumpsuit", 0), ("Jumpsuit", 2), ("Dress", 0), ("Dress", 2)),
    ],
)
def test_outfits_of_the_generator_fit_their_templates(toy_body, dress_forms, made, kind, seed):
    for garment in worn(toy_body, dress_forms, kind, seed):
        template = made[garment.name]
        fit = fit_to_template(garment.vertices, garment.faces, FitTarget(template))
        found = residual(garment.vertices, garment.faces, template, remesh_table(fit))
        assert max(found[:3]) < 5
        few = 0 if garment.name in GARMENT4D_TYPES else 0.02 * len(template.faces)
        assert found.flipped_faces <= few


@pytest.fixture(scope="module")
def sleeveless(toy_body, dress_forms):
    """A dress with straps."""
    (dress,) = worn(toy_body, dress_forms, "Dress", 4)
    assert "sleeve_length" not in dress.attributes["parameters"]["upper"]
    return dress


def most_away_m(fit):
    """How far the vertex of a fitted garment that is furthest off its template is."""
    place, _ = closest_points(fit.vertices, fit.target.vertices, fit.target.template.faces)
    return np.linalg.norm(fit.vertices - place, axis=1).max()


def test_a_dress_without_sleeves_keeps_its_surface_on_a_template_with_them(made, sleeveless):
    template = made["Dress"]
    fit = fit_to_template(sleeveless.vertices, sleeveless.faces, template)
    table = remesh_table(fit)
    found = residual(sleeveless.vertices, sleeveless.faces, template, table)
    assert max(found[:3]) < 4
    # Drawn along whole sleeves, cloth from the sides would hang under the arms.
    whole = FitTarget(template)
    whole.sleeved = False
    drawn = fit_to_template(sleeveless.vertices, sleeveless.faces, whole)
    assert most_away_m(fit) < 0.75 * most_away_m(drawn)
    new = remesh(sleeveless.vertices, table)
    loops = boundary_loops(triangulate(sleeveless.faces))
    for side, sign in (("left", 1), ("right", -1)):
        armhole = max(loops, key=lambda loop: sign * sleeveless.vertices[loop, 0].mean())
        cuff = template.loop == template.loop_names.index(f"{side}_cuff")
        assert np.isin(table.corners[cuff], armhole).all()
        np.testing.assert_allclose(
            new[cuff].mean(axis=0), sleeveless.vertices[armhole].mean(axis=0), atol=0.01
        )


def test_a_garment_with_sleeves_and_one_without_are_fitted_to_templates_of_their_kind(
    made, sleeveless
):
    target = FitTarget(made["Dress"])
    settings = TemplateFitSettings(iterations=0)

    def fitted_to(vertices, faces):
        return fit_to_template(vertices, faces, target, settings).target

    assert fitted_to(target.vertices, target.template.faces) is target
    assert fitted_to(sleeveless.vertices, sleeveless.faces) is target.stubbed
    # A top has no sleeves, and neither has its template: nothing is changed.
    top = FitTarget(made["Top"])
    assert fit_to_template(top.vertices, top.template.faces, top, settings).target is top


def test_short_sleeves_of_a_template_are_a_quarter_as_long(made):
    target = FitTarget(made["Tshirt"])
    short = target.stubbed
    armpit = max(float(target.vertices[guide[0], 0]) for guide in target.guides)
    before, after = (abs(each.vertices[:, 0]) for each in (target, short))
    far = before > armpit + 0.02
    np.testing.assert_allclose(after[far] - armpit, 0.25 * (before[far] - armpit), atol=0.004)
    near = before < armpit - 0.02
    np.testing.assert_array_equal(short.vertices[near], target.vertices[near])
    np.testing.assert_array_equal(short.vertices[:, 1:], target.vertices[:, 1:])
    for name, loop in target.loops.items():
        np.testing.assert_array_equal(np.sort(short.loops[name]), np.sort(loop))


def test_a_type_that_there_is_not_is_refused():
    with pytest.raises(InputError, match="there is no garment type 'Kilt', expected one of Tshirt"):
        make_template("Kilt", {}, {}, 0.05)


def test_a_user_s_skirt_becomes_a_template(tmp_path, toy_body):
    mesh = tube(0.25, -0.5, 0.0)
    save_obj(tmp_path / "skirt.obj", Mesh(mesh.vertices, mesh.faces))
    template = template_from_mesh("Skirt", tmp_path / "skirt.obj", toy_body)
    np.testing.assert_allclose(template.vertices, mesh.vertices, atol=1e-5)
    np.testing.assert_array_equal(template.faces, triangulate(mesh.faces))
    np.testing.assert_allclose(template.vertices[template.loop == 0, 2], 0, atol=1e-6)
    np.testing.assert_allclose(template.vertices[template.loop == 1, 2], -0.5, atol=1e-6)


def test_a_user_s_mesh_with_other_openings_is_refused(tmp_path, toy_body):
    mesh = tube(0.25, -0.5, 0.0)
    save_obj(tmp_path / "tube.obj", Mesh(mesh.vertices, mesh.faces))
    with pytest.raises(InputError, match=r"tube\.obj: 2 openings, expected 3 \(waist, left_leg"):
        template_from_mesh("Trousers", tmp_path / "tube.obj", toy_body)
