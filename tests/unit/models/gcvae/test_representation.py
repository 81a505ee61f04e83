import numpy as np
import pytest

from drapeline.geometry.mesh import Mesh
from drapeline.metrics.garment import garment_mesh
from drapeline.models.contract import HeldOutGarment
from drapeline.models.gcvae.codec import decode_codes, encode_garments
from drapeline.models.gcvae.representation import OffsetPca, RegisteredOffsets, VaeCode
from drapeline.outfits.garment_types import GARMENTS
from toys.gcvae import toy_template


def as_registered(garments, row):
    template = toy_template()
    body = template.rest_body(garments.cvar([row])[0])
    faces = template.faces_of(GARMENTS[garments.garment[row]])
    return garment_mesh(body + garments.offsets[row], faces, garments.mask[row])


@pytest.fixture
def held_out(garments):
    return [
        HeldOutGarment(
            int(row),
            str(garments.outfit[row]),
            GARMENTS[garments.garment[row]],
            as_registered(garments, row),
        )
        for row in garments.rows("test")
    ]


def assert_same(mesh: Mesh, expected: Mesh, atol=0.0):
    np.testing.assert_array_equal(mesh.faces, expected.faces)
    np.testing.assert_allclose(mesh.vertices, expected.vertices, atol=atol)


def test_registered_offsets_give_back_what_was_registered(garments, held_out):
    registered = RegisteredOffsets(garments, toy_template())
    for one, mesh in zip(held_out, registered.rebuild(held_out), strict=True):
        assert_same(mesh, one.mesh)
        assert registered.code_numbers(one.garment) is None


def test_pca_gives_training_garments_back_if_it_has_as_many_components(garments):
    rows = garments.rows("train")[:3]
    training = [HeldOutGarment(row, "", "", as_registered(garments, row)) for row in rows]
    pca = OffsetPca(garments, toy_template(), 64)
    assert pca.code_numbers("Dress") == len(pca._pca.axes) <= 64
    assert OffsetPca(garments, toy_template(), 2).code_numbers("Dress") == 2
    for one, mesh in zip(training, pca.rebuild(training), strict=True):
        assert_same(mesh, one.mesh, atol=1e-5)


def test_a_vae_gives_back_what_it_decodes_from_the_mean_of_the_posterior(model, garments, held_out):
    rows = garments.rows("test")
    z = encode_garments(model, garments, rows).mean
    decoded = decode_codes(model, z, garments.cvar(rows), garments.topology(rows))
    code = VaeCode("svae", model, garments)
    assert (code.variant, code.code_numbers("Dress")) == ("svae", 5)
    template = model.body_template
    for one, mesh, (offsets, mask) in zip(held_out, code.rebuild(held_out), decoded, strict=True):
        body = template.rest_body(garments.cvar([one.row])[0])
        faces = template.faces_of(GARMENTS[garments.garment[one.row]])
        assert_same(mesh, garment_mesh(body + offsets, faces, mask))
