"""Garments the user brings."""

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.obj import save_obj
from drapeline.outfits.fabrics import FABRICS
from drapeline.outfits.generate import sample_outfit
from drapeline.outfits.settings import OwnGarment
from drapeline.outfits.user_garment import load_user_garment, openings, rims
from drapeline.seeding import rng_for


@pytest.fixture(scope="module")
def skirt(toy_body):
    """An open cone around the hips, without texture coordinates."""
    around, rows = 32, 8
    angle = 2 * np.pi * np.arange(around) / around
    grid = [
        [(r * np.cos(a), r * np.sin(a), z) for a in angle]
        for r, z in zip(np.linspace(0.3, 0.2, rows), np.linspace(-0.5, 0.05, rows), strict=True)
    ]
    ids = np.arange(rows * around).reshape(rows, around)
    after = np.roll(ids, -1, axis=1)
    faces = np.stack([ids[:-1], after[:-1], after[1:], ids[1:]], axis=-1).reshape(-1, 4)
    return Mesh(np.array(grid, dtype=np.float32).reshape(-1, 3), faces.astype(np.int32))


def saved(tmp_path, mesh, vertices=None, faces=None):
    path = tmp_path / "mine.obj"
    changed = Mesh(
        mesh.vertices if vertices is None else vertices, mesh.faces if faces is None else faces
    )
    save_obj(path, changed)
    return path


def test_a_sound_garment_comes_back_with_a_texture_map(tmp_path, skirt, toy_body):
    mesh = load_user_garment(saved(tmp_path, skirt), toy_body)
    np.testing.assert_array_equal(mesh.faces, skirt.faces)
    assert mesh.uv.min() >= 0
    assert mesh.uv.max() <= 1
    assert mesh.uv_faces.shape == mesh.faces.shape


def test_an_own_garment_takes_the_place_of_the_template(tmp_path, skirt, toy_body, templates):
    path = str(saved(tmp_path, skirt))
    outfit = sample_outfit(
        rng_for(1, "own"),
        templates,
        toy_body,
        gender="female",
        shape=np.zeros(10),
        outfit_type="Tshirt+Skirt",
        edge_length_m=0.03,
        own={"Skirt": OwnGarment(path=str(path))},
    )
    mine = outfit.garments[0]
    np.testing.assert_array_equal(mine.faces, skirt.faces)
    assert mine.attributes["parameters"] == {"own_garment": path, "held": ["top"]}
    assert mine.attributes["fabric"] in FABRICS
    assert not mine.elastic.any()
    np.testing.assert_array_equal(mine.pin, skirt.vertices[:, 2] > 0.04)


def test_fabric_elastics_and_held_rims_are_as_asked_for(tmp_path, skirt, toy_body, templates):
    asked = OwnGarment(
        path=str(saved(tmp_path, skirt)), fabric="leather", elastic=("bottom",), held=()
    )
    outfit = sample_outfit(
        rng_for(1, "own"),
        templates,
        toy_body,
        gender="male",
        shape=np.zeros(10),
        outfit_type="Top+Skirt",
        edge_length_m=0.03,
        own={"Skirt": asked},
    )
    mine = outfit.garments[0]
    assert mine.attributes["fabric"] == "leather"
    assert mine.attributes["elastic"] == {"bottom": True}
    assert not mine.pin.any()
    np.testing.assert_array_equal(mine.elastic, skirt.vertices[:, 2] < -0.49)


def tube_along(axis, centre, radius=0.1):
    """Vertices and faces of a short open tube."""
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    points = np.concatenate([ring, ring + [0, 0, 0.3]])
    points = np.roll(points, axis - 2, axis=1) + centre
    ids = np.arange(12)
    after = np.roll(ids, -1)
    return points, np.stack([ids, after, after + 12, ids + 12], axis=1)


def joined(*parts):
    counts = np.cumsum([0, *(len(points) for points, _ in parts)])
    faces = [faces + count for (_, faces), count in zip(parts, counts, strict=False)]
    points = np.concatenate([points for points, _ in parts]).astype(np.float32)
    return Mesh(points, np.concatenate(faces).astype(np.int32))


def test_openings_are_named_by_where_they_are():
    mesh = joined(
        tube_along(2, [0, 0, 0.1]),
        tube_along(0, [0.4, 0, 0.4], 0.05),
        tube_along(0, [-0.7, 0, 0.4], 0.05),
        tube_along(2, [0.15, 0, -0.7]),
        tube_along(2, [-0.15, 0, -0.7]),
    )
    there = openings(mesh)
    places = {name: mesh.vertices[ids] for name, ids in there.items()}
    np.testing.assert_allclose(places["top"][:, 2], 0.4, atol=1e-6)
    np.testing.assert_allclose(places["bottom"][:, 2], 0.1, atol=1e-6)
    assert (places["sleeves"][:, 2] > 0.3).all()
    assert (places["legs"][:, 2] < -0.3).all()
    assert sum(map(len, there.values())) == len(mesh.vertices)
    for side in (-1, 1):
        assert (side * places["sleeves"][:, 0] > 0).any()
        assert (side * places["legs"][:, 0] > 0).any()


def test_trousers_have_no_bottom_but_legs(tmp_path):
    mesh = joined(tube_along(2, [0.15, 0, -0.7]), tube_along(2, [-0.15, 0, -0.7]))
    assert list(openings(mesh)) == ["legs"]
    with pytest.raises(InputError, match=r"mine\.obj: has no opening 'bottom', expected legs"):
        rims("mine.obj", mesh, ["bottom"], 0.02)
    np.testing.assert_array_equal(rims("mine.obj", mesh, [], 0.02), 0)


def test_centimetres_are_recognised(tmp_path, skirt, toy_body):
    path = saved(tmp_path, skirt, vertices=skirt.vertices * 100)
    with pytest.raises(InputError, match=r"mine\.obj.* 60 m long.*centimetres.*expected metres"):
        load_user_garment(path, toy_body)


def test_a_garment_away_from_the_body_is_refused(tmp_path, skirt, toy_body):
    path = saved(tmp_path, skirt, vertices=skirt.vertices + np.float32([0, 0, 3]))
    with pytest.raises(InputError, match=r"mine\.obj.* m from the rest body.*expected it on"):
        load_user_garment(path, toy_body)


def test_non_manifold_edges_are_named(tmp_path, skirt, toy_body):
    extra = np.array([[0, 1, 100, 101], [0, 1, 150, 151]], dtype=np.int32)
    path = saved(tmp_path, skirt, faces=np.concatenate([skirt.faces, extra]))
    with pytest.raises(InputError, match=r"mine\.obj.*non-manifold.*vertices 1 and 2 with 3 faces"):
        load_user_garment(path, toy_body)


def test_faces_turned_against_each_other_are_refused(tmp_path, skirt, toy_body):
    faces = skirt.faces.copy()
    faces[5] = faces[5][::-1]
    with pytest.raises(InputError, match="turned the same way"):
        load_user_garment(saved(tmp_path, skirt, faces=faces), toy_body)


def test_values_that_are_no_numbers_are_refused(tmp_path, skirt, toy_body):
    vertices = skirt.vertices.copy()
    vertices[7, 1] = np.nan
    with pytest.raises(InputError, match="vertex 8 is not finite"):
        load_user_garment(saved(tmp_path, skirt, vertices=vertices), toy_body)


def test_a_closed_surface_is_no_garment(tmp_path, toy_body):
    box = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float32)
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    mesh = Mesh(box * 0.4, np.array(faces, dtype=np.int32))
    with pytest.raises(InputError, match="closed surface"):
        load_user_garment(saved(tmp_path, mesh), toy_body)


def test_a_missing_file_is_named(tmp_path, toy_body):
    with pytest.raises(InputError, match=r"nothing\.obj"):
        load_user_garment(tmp_path / "nothing.obj", toy_body)
