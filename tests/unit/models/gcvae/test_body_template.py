"""The template that networks are built on, and rest bodies of conditions."""

from dataclasses import replace

import numpy as np
import torch

from drapeline.bodies.model import posed_vertices
from drapeline.bodies.rest_body import rest_basis
from drapeline.frames import REST_POSE
from drapeline.models.gcvae.data import BodyTemplate, rest_bodies
from drapeline.models.gcvae.sample import wearer_mesh
from toys.gcvae import toy_template


def test_a_wearer_between_the_genders_is_between_their_bodies(toy_body):
    bodies = {"female": toy_body, "male": replace(toy_body, v_template=1.2 * toy_body.v_template)}
    cvar = np.zeros(13)
    made = []
    for gender in (0, 0.5, 1):
        cvar[10] = gender
        made.append(wearer_mesh(bodies, cvar).vertices)
    np.testing.assert_allclose(made[1], (made[0] + made[2]) / 2, atol=1e-6)
    assert not np.allclose(made[0], made[2])


def test_a_template_survives_its_flat_form():
    body_template = toy_template()
    again = BodyTemplate.from_tensors(body_template.tensors())
    np.testing.assert_array_equal(again.offset_std, body_template.offset_std)
    for name in ("body", "skirt"):
        for key in ("edges", "parents"):
            pairs = zip(getattr(again, key)[name], getattr(body_template, key)[name], strict=True)
            assert all(np.array_equal(a, b) for a, b in pairs)


def test_rest_bodies_are_the_posed_bodies_exactly(toy_body):
    bodies = {"female": toy_body, "male": replace(toy_body, v_template=1.2 * toy_body.v_template)}
    basis = torch.from_numpy(rest_basis(bodies))
    shape = np.linspace(-1, 1, 10)
    for gender, body in enumerate(bodies.values()):
        cvar = torch.tensor([[*shape, gender, 0.1, 0.2]], dtype=torch.float32)
        made = rest_bodies(basis, cvar)[..., 0]
        true = posed_vertices(body, shape, REST_POSE[None])[0][0]
        np.testing.assert_allclose(made, true, atol=1e-5)
