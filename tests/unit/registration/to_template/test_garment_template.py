"""Templates in their files, and which of their openings is which."""

import numpy as np
import pytest

from drapeline.bodies.rest_body import rest_body
from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh, boundary_loops, edges, face_normals, triangulate
from drapeline.geometry.obj import save_obj
from drapeline.outfits.garment_types import TEMPLATE_TYPES
from drapeline.outfits.generate import sample_outfit
from drapeline.outfits.templates import build_templates
from drapeline.registration.to_template import garment_template as making
from drapeline.registration.to_template.garment_template import (
    LOOP_NAMES,
    load_template,
    make_template,
    named_loops,
    template_from_mesh,
)
from drapeline.registration.to_template.remesh import remesh_table, residual
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
PLACES = {
    "Skirt": {"waist": (0, 0, 0), "hem": (0, 0, -0.5)},
    "Tshirt": {
        "neck": (0, 0, 0.5),
        "hem": (0, 0, -0.1),
        "left_cuff": (0.4, 0, 0.3),
        "right_cuff": (-0.4, 0, 0.3),
    },
    "Trousers": {"waist": (0, 0, 0), "left_cuff": (0.3, 0, -0.9), "right_cuff": (-0.3, 0, -0.9)},
}


@pytest.mark.parametrize("garment", PLACES)
def test_openings_are_told_apart_in_whatever_order_they_come(garment):
    places = PLACES[garment]
    points = np.array([*places.values()], dtype=float)
    loops = [np.array([index]) for index in range(len(points))]
    for turn in range(len(loops)):
        found = named_loops(points, loops[turn:] + loops[:turn], LOOP_NAMES[garment])
        assert {name: ids.tolist() for name, ids in found.items()} == {
            name: [index] for index, name in enumerate(places)
        }


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
    return {name: make_template(name, dress_forms, bodies, 0.035) for name in TEMPLATE_TYPES}


@pytest.mark.parametrize("garment", TEMPLATE_TYPES)
def test_a_template_has_the_openings_of_its_type(made, garment):
    template = made[garment]
    loops = boundary_loops(template.faces)
    assert template.loop_names == LOOP_NAMES[garment]
    assert len(loops) == len(template.loop_names)
    for loop in loops:
        assert len(set(template.loop[loop].tolist())) == 1
        assert template.loop[loop[0]] >= 0
    assert (template.loop >= 0).sum() == sum(map(len, loops))
    middle = {
        name: template.vertices[template.loop == k].mean(axis=0)
        for k, name in enumerate(template.loop_names)
    }
    upper, lower = ("neck", "hem") if garment == "Tshirt" else ("waist", "hem")
    if lower in middle:
        assert middle[upper][2] > middle[lower][2] + 0.2
    if "left_cuff" in middle:
        np.testing.assert_allclose(
            middle["left_cuff"], middle["right_cuff"] * [-1, 1, 1], atol=0.02
        )
        assert middle["left_cuff"][0] > 0.05


@pytest.mark.parametrize("garment", ["Top", "Dress"])
def test_another_type_needs_no_more_than_the_names_of_its_openings(
    toy_body, dress_forms, monkeypatch, garment
):
    openings = ("neck", "hem", "left_cuff", "right_cuff")
    monkeypatch.setattr(making, "TEMPLATE_TYPES", (*TEMPLATE_TYPES, garment))
    monkeypatch.setitem(LOOP_NAMES, garment, openings)
    template = make_template(garment, dress_forms, {"female": toy_body}, 0.035)
    middle = [template.vertices[template.loop == k].mean(axis=0) for k in range(len(openings))]
    assert middle[0][2] > max(middle[2][2], middle[3][2]) > middle[1][2]
    assert middle[2][0] > 0.05 > -0.05 > middle[3][0]


@pytest.mark.parametrize("garment", TEMPLATE_TYPES)
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


@pytest.mark.parametrize(("kind", "seed"), [("Tshirt+Trousers", 0), ("Top+Skirt", 1)])
def test_outfits_of_the_generator_fit_their_templates(toy_body, dress_forms, made, kind, seed):
    outfit = sample_outfit(
        rng_for(seed, "worn"),
        dress_forms["female"],
        toy_body,
        gender="female",
        shape=rng_for(seed, "shape").uniform(-1, 1, 10),
        outfit_type=kind,
        edge_length_m=0.035,
    )
    garments = [g for g in outfit.garments if g.name in made]
    assert garments
    for garment in garments:
        template = made[garment.name]
        fit = fit_to_template(garment.vertices, garment.faces, FitTarget(template))
        found = residual(garment.vertices, garment.faces, template, remesh_table(fit, template))
        assert max(found[:3]) < 5
        assert found.flipped_faces == 0


def test_a_type_without_templates_is_refused():
    with pytest.raises(InputError, match="'Dress' has no template, expected one of Skirt"):
        make_template("Dress", {}, {}, 0.05)


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
    with pytest.raises(InputError, match=r"tube\.obj: 2 openings, expected 3 \(waist, left_cuff"):
        template_from_mesh("Trousers", tmp_path / "tube.obj", toy_body)
