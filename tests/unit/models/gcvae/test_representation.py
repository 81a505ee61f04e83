"""Representations of garments, and codes from the points of a scan."""

import numpy as np
import pytest
import torch

from drapeline.bodies.moved_body import BodyState
from drapeline.dataset.segmented_scans import SegmentedScan
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.baselines import fit_training_pca, garment_baselines
from drapeline.metrics.garment import garment_mesh
from drapeline.models.contract import HeldOutGarment
from drapeline.models.gcvae.codec import decode_codes, encode_garments
from drapeline.models.gcvae.representation import (
    CodeScanFitter,
    FitCode,
    GuessedOffsets,
    OffsetPca,
    RegisteredOffsets,
    RegisteredPoints,
    VaeCode,
    fit_code,
    register_points,
)
from drapeline.outfits.garment_types import GARMENTS, LABELS
from toys.gcvae import VERTICES, ToyGarments, toy_template, tube


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
    fitted = fit_training_pca(garments, None, components=64, seed=0)
    pca = OffsetPca("body_pca", fitted, garments, toy_template())
    assert pca.code_numbers("Dress") == len(fitted.axes) <= 64
    short = OffsetPca("body_pca_2", fitted.first(2), garments, toy_template())
    assert (short.variant, short.code_numbers("Dress")) == ("body_pca_2", 2)
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


def test_guesses_are_worn_by_the_body_of_the_garment(garments, held_out):
    template = toy_template()
    for variant, guess in garment_baselines(garments).items():
        guessed = GuessedOffsets(variant, guess, garments, template)
        assert guessed.variant == variant
        for one, mesh in zip(held_out, guessed.rebuild(held_out), strict=True):
            assert guessed.code_numbers(one.garment) is None
            body = template.rest_body(garments.cvar([one.row])[0])
            offsets, mask = guess(one.row)
            assert_same(mesh, garment_mesh(body + offsets, template.faces_of(one.garment), mask))


STATE = BodyState.of(REST_POSE, np.zeros(3), np.zeros(10))


def scan(garments, **clouds):
    labels = np.repeat([LABELS.index(name) for name in clouds], [len(c) for c in clouds.values()])
    points = np.concatenate([*clouds.values()]).astype(np.float32)
    return SegmentedScan("s", 0, points, labels.astype(np.uint8), garments, "female", STATE, None)


def test_vertices_get_the_nearest_points_and_know_what_is_hidden():
    body = tube()
    cloth, skin, cover = body[96:] * [1.2, 1.2, 1], body[:48], body[48:96] * [1.5, 1.5, 1]
    shown = scan(("Trousers", "Top"), Body=skin, Trousers=cloth, Top=cover)
    found = register_points(body, shown.points, shown, "Trousers")
    np.testing.assert_allclose(found.offsets[96:], 0.2 * body[96:] * [1, 1, 0], atol=1e-6)
    assert not found.mask[:48].any()
    assert found.mask[110:].all()
    assert found.known[:36].all()
    assert not found.known[60:84].any()


@pytest.mark.portable
def test_codes_start_where_the_model_encodes_and_go_down_the_slope(fitted):
    """A prior that outweighs the garment has its least value at a code of zero."""
    garments = ToyGarments()
    rows = garments.rows("test")[:1]
    batch = {
        "offsets": torch.from_numpy(garments.offsets[rows]),
        "mask": torch.from_numpy(garments.mask[rows]),
        "cvar": torch.from_numpy(garments.cvar(rows)),
        "topology": torch.from_numpy(garments.topology(rows)),
    }
    start = fitted.encode(batch).mean.numpy()
    registered = RegisteredPoints(
        garments.offsets[rows[0]], garments.mask[rows[0]], np.ones(VERTICES, dtype=bool)
    )
    given = garments.cvar(rows), garments.topology(rows), registered
    still = fit_code(fitted, *given, FitCode(steps=0))
    np.testing.assert_allclose(still, start, atol=1e-5)
    drawn = fit_code(fitted, *given, FitCode(steps=200, prior=1e6))
    assert np.abs(drawn).max() < 0.1 * np.abs(start).max()


def test_every_model_finds_every_garment(fitted, toy_body):
    template = toy_template()
    rest = template.rest_body(np.zeros(13, dtype=np.float32))
    shown = scan(
        ("Trousers", "Top"),
        Body=toy_body.v_template[:200],
        Trousers=rest[:96] * [1.2, 1.2, 1],
        Top=rest[96:] * [1.3, 1.3, 1],
    )
    bodies = {"female": toy_body, "male": toy_body}
    fitter = CodeScanFitter({"one": fitted, "two": fitted}, bodies, FitCode(steps=2))
    found = fitter.fit(shown, STATE)
    assert fitter.watch.seconds.keys() == found.keys()
    assert {variant: set(garments) for variant, garments in found.items()} == {
        variant: {"Trousers", "Top"} for variant in ("one", "one_moved", "two", "two_moved")
    }
    for mesh in found["one"].values():
        assert np.isfinite(mesh.vertices).all()
