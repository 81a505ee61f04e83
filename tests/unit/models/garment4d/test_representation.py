import numpy as np
import pytest

from drapeline.geometry.mesh import Mesh
from drapeline.models.contract import HeldOutGarment
from drapeline.models.garment4d.representation import RegisteredTemplate, TemplatePca
from drapeline.registration.to_template.garment_space import fit_space
from drapeline.registration.to_template.remesh import RemeshTable

FACES = np.array([[0, 1, 2], [2, 1, 3]], dtype=np.int32)
SOURCE_FACES = np.array([[0, 1, 2]], dtype=np.int32)


@pytest.fixture(scope="module")
def spaces():
    rng = np.random.default_rng(0)
    garments = {"Skirt": rng.normal(size=(9, 4, 3)), "Tshirt": rng.normal(size=(9, 4, 3))}
    return {
        "Skirt": fit_space(garments["Skirt"], 8, FACES),
        "Tshirt": fit_space(garments["Tshirt"], 3, FACES),
    }


@pytest.fixture(scope="module")
def tables():
    """The template's vertices are the corners of the only triangle, and its centre."""
    corners = np.array([[0, 1, 2]] * 4, dtype=np.int32)
    shares = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1 / 3] * 3], dtype=np.float32)
    table = RemeshTable(corners, shares)
    return {"Skirt": {"s1": table}, "Tshirt": {"s2": table}}


@pytest.fixture(scope="module")
def held_out():
    vertices = np.float32([[0, 0, 0], [3, 0, 0], [0, 3, 0]])
    return [
        HeldOutGarment(0, "s1", "Skirt", Mesh(vertices, SOURCE_FACES)),
        HeldOutGarment(1, "s2", "Tshirt", Mesh(vertices + 1, SOURCE_FACES)),
    ]


def test_the_registered_template_lies_on_the_garment(spaces, tables, held_out):
    registered = RegisteredTemplate(spaces, tables)
    for one, mesh in zip(held_out, registered.rebuild(held_out), strict=True):
        corners = one.mesh.vertices
        expected = np.concatenate([corners, corners.mean(axis=0, keepdims=True)])
        np.testing.assert_allclose(mesh.vertices, expected, atol=1e-6)
        np.testing.assert_array_equal(mesh.faces, FACES)
        assert registered.code_numbers(one.garment) is None


def test_principal_components_give_back_the_nearest_garment_of_their_space(
    spaces, tables, held_out
):
    pca, registered = TemplatePca(spaces, tables), RegisteredTemplate(spaces, tables)
    assert (pca.code_numbers("Skirt"), pca.code_numbers("Tshirt")) == (8, 3)
    for one, held, mesh in zip(
        held_out, pca.rebuild(held_out), registered.rebuild(held_out), strict=True
    ):
        space = spaces[one.garment]
        np.testing.assert_allclose(
            space.coefficients(held.vertices), space.coefficients(mesh.vertices), atol=1e-4
        )
        outside = np.linalg.norm(held.vertices - mesh.vertices)
        assert outside > 0.01  # 8 or 3 directions of 12


def test_all_components_by_their_number_are_the_whole_code(spaces, tables, held_out):
    whole, counted = TemplatePca(spaces, tables), TemplatePca(spaces, tables, 8)
    assert (whole.variant, counted.variant) == ("garment4d_pca", "garment4d_pca_8")
    for name in spaces:
        assert counted.code_numbers(name) == whole.code_numbers(name)
    for one, other in zip(whole.rebuild(held_out), counted.rebuild(held_out), strict=True):
        np.testing.assert_array_equal(one.vertices, other.vertices)


def test_fewer_components_rebuild_garments_no_better(spaces, tables, held_out):
    """By the squares that the components are fitted to."""
    registered = [mesh.vertices for mesh in RegisteredTemplate(spaces, tables).rebuild(held_out)]
    errors = []
    for count in range(9):
        pca = TemplatePca(spaces, tables, count)
        assert (pca.code_numbers("Skirt"), pca.code_numbers("Tshirt")) == (count, min(count, 3))
        away = [mesh.vertices for mesh in pca.rebuild(held_out)]
        scales = [spaces[one.garment].scale for one in held_out]
        parts = zip(away, registered, scales, strict=True)
        errors.append([np.linalg.norm((found - true) / by) for found, true, by in parts])
    assert (np.diff(errors, axis=0) < 1e-5).all()
    assert (np.array(errors[-1]) < 0.9 * np.array(errors[0])).all()
    for one, vertices in zip(
        held_out, TemplatePca(spaces, tables, 0).rebuild(held_out), strict=True
    ):
        np.testing.assert_allclose(vertices.vertices, spaces[one.garment].mean, atol=1e-6)
