"""Garments the user brings."""

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh, boundary_loops
from drapeline.geometry.obj import save_obj
from drapeline.outfits.generate import sample_outfit
from drapeline.outfits.user_garment import load_user_garment, top_loop
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
    assert mesh.vertices[top_loop(mesh), 2] == pytest.approx(0.05)


def test_an_own_garment_takes_the_place_of_the_template(tmp_path, skirt, toy_body, templates):
    path = saved(tmp_path, skirt)
    outfit = sample_outfit(
        rng_for(1, "own"),
        templates,
        toy_body,
        gender="female",
        shape=np.zeros(10),
        outfit_type="Tshirt+Skirt",
        edge_length_m=0.03,
        own={"Skirt": path},
    )
    mine = outfit.garments[0]
    np.testing.assert_array_equal(mine.faces, skirt.faces)
    assert mine.about["parameters"] == {"own_garment": str(path)}
    assert set(np.flatnonzero(mine.pin)) == set(boundary_loops(skirt.faces)[0]) or set(
        np.flatnonzero(mine.pin)
    ) == set(boundary_loops(skirt.faces)[1])
    assert mine.pin[skirt.vertices[:, 2] > 0.04].all()


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
