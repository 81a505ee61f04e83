"""Mirror images of a mesh's vertices."""

import numpy as np
import pytest

from drapeline.bodies.bake_surface import mirror_map


def test_a_vertex_and_its_mirror_image_name_each_other():
    vertices = np.array([[0.1, 0.2, 0.3], [0.0, 1.0, 0.0], [-0.1, 0.2, 0.3], [0.0, -1.0, 0.0]])
    assert mirror_map(vertices, axis=0).tolist() == [2, 1, 0, 3]
    swapped = vertices[:, [1, 0, 2]]
    assert mirror_map(swapped, axis=1).tolist() == [2, 1, 0, 3]


def test_the_toy_body_is_its_own_mirror_image(toy_body):
    mirror = mirror_map(toy_body.v_template.astype(np.float64), axis=0)
    np.testing.assert_array_equal(mirror[mirror], np.arange(len(mirror)))
    np.testing.assert_allclose(
        toy_body.v_template[mirror], toy_body.v_template * [-1, 1, 1], atol=1e-6
    )


def test_a_mesh_that_is_not_symmetric_is_refused():
    vertices = np.array([[0.1, 0.0, 0.0], [-0.1003, 0.0, 0.0]])
    with pytest.raises(ValueError, match="the mesh is not symmetric: 3.00e-04 m"):
        mirror_map(vertices, axis=0)
