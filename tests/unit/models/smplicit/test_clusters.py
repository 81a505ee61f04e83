from dataclasses import replace

import numpy as np
import torch

from drapeline.bodies.rest_body import rest_body
from drapeline.frames import GENDERS
from drapeline.models.smplicit.network import BASIS_ROWS, cluster_basis, cluster_places
from drapeline.seeding import rng_for

CLUSTERS = np.array([3, 50, 400])


def test_clusters_are_vertices_of_the_body_at_rest(toy_body):
    taller = replace(toy_body, v_template=1.1 * toy_body.v_template)
    bodies = dict(zip(GENDERS, (toy_body, taller), strict=True))
    basis = cluster_basis(bodies, CLUSTERS)
    assert basis.shape == (BASIS_ROWS, 3, 3)
    shapes = rng_for(0, "shapes").normal(size=(2, 10))
    places = cluster_places(basis, torch.from_numpy(shapes).float(), torch.tensor([1, 0]))
    for found, shape, gender in zip(places, shapes, ("male", "female"), strict=True):
        expected = rest_body(bodies[gender], shape)[CLUSTERS]
        np.testing.assert_allclose(found, expected, atol=1e-5)
