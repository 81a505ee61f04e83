from dataclasses import replace

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh, faces_within
from drapeline.geometry.smoothing import averaging_matrix
from drapeline.metrics.garment import BodyInside, garment_mesh, largest_piece
from drapeline.models.gcvae.codec import decode_codes
from drapeline.models.gcvae.sample import (
    _DRAWS_MAX,
    SampledGarment,
    fill_holes,
    mend,
    sample_garments,
    sample_table,
)
from drapeline.models.gcvae.vae import StaticVae
from toys.gcvae import AROUND, VERTICES, half, toy_template, tube_faces
from toys.gcvae_files import SETTINGS, requests


def test_a_model_without_a_mask_cannot_be_sampled(types):
    settings = SETTINGS.replace(training={"mask": False})
    with pytest.raises(InputError, match="without a mask branch cannot be sampled"):
        model = StaticVae(settings, toy_template()).eval()
        sample_garments(model, types, requests(), seed=0, settle=False)


def test_more_samples_leave_the_first_ones_alone():
    few, many = requests(3), requests(9)
    for name, request in few.items():
        np.testing.assert_array_equal(request.cvar, many[name].cvar)
    assert [r.garment for r in many.values()] == ["prior", "Dress"] * 4 + ["prior"]


def test_conditions_are_in_their_ranges_or_as_asked():
    drawn = np.stack([r.cvar for r in requests(200).values()])
    assert (np.abs(drawn[:, :10]) <= 1).all()
    assert np.abs(drawn[:, :10]).max() > 0.9
    assert set(drawn[:, 10]) == {0, 1}
    female = drawn[:, 10] == 0
    assert ((drawn[female, 11] >= -0.5) & (drawn[female, 11] <= 1.5)).all()  # the sign is turned
    assert ((drawn[:, 12] >= -1.5) & (drawn[:, 12] <= 0.5)).all()
    asked = requests(5, female_share=0, shape=np.arange(10) / 10, tightness=[-1, 0.25])
    for request in asked.values():
        np.testing.assert_allclose(request.cvar, [*np.arange(10) / 10, 1, -1, 0.25], atol=1e-6)


def test_samples_are_decoded_on_the_topology_of_their_type(model, types, halves):
    asked = requests(12, ("prior", "Dress", "Trousers"))
    sampled = sample_garments(model, types, asked, seed=3, settle=False)
    for sample in sampled:
        assert sample.garment in ("Dress", "Trousers")
        if sample.request.garment != "prior":
            assert sample.garment == sample.request.garment
        else:
            assert (sample.garment == "Dress") == (sample.z[0] > 0)
        faces = model.body_template.faces["skirt" if sample.garment == "Dress" else "body"]
        assert len(sample.decoded.faces) == len(faces_within(faces, half(sample.z[0] > 0)))
        np.testing.assert_array_equal(
            sample.body, model.body_template.rest_body(sample.request.cvar)
        )
    again = sample_garments(model, types, asked, seed=3, settle=False)
    other = sample_garments(model, types, asked, seed=4, settle=False)
    np.testing.assert_array_equal(again[0].decoded.vertices, sampled[0].decoded.vertices)
    assert not np.array_equal(other[0].z, sampled[0].z)


def test_cleaning_takes_pieces_off_and_moves_nothing(model, types, monkeypatch):
    def with_a_gap(*args):
        """Rings 0-3 and 6-15 are garment: two pieces."""
        for offsets, mask in decode_codes(*args):
            mask[:] = (np.arange(VERTICES) // AROUND < 4) | (np.arange(VERTICES) // AROUND >= 6)
            yield offsets, mask

    monkeypatch.setattr("drapeline.models.gcvae.sample.decode_codes", with_a_gap)
    sampled = sample_garments(model, types, requests(6), seed=0, settle=False)
    rows = sample_table(sampled, model.body_template.faces["body"], {})
    for sample, row in zip(sampled, rows, strict=True):
        assert (row["pieces_before"], row["pieces"]) == (2, 1)
        assert row["vertices"] == 10 * AROUND
        before = {tuple(v) for v in sample.decoded.vertices.tolist()}
        assert {tuple(v) for v in sample.mesh.vertices.tolist()} <= before
        assert row["kept_share"] == pytest.approx(
            len(sample.mesh.vertices) / max(len(before), 1), abs=1e-9
        )


def test_settled_garments_are_the_decoded_ones_mended(model, types):
    asked = requests(6)
    plain = sample_garments(model, types, asked, seed=0, settle=False)
    sampled = sample_garments(model, types, asked, seed=0, settle=True)
    body_faces = model.body_template.faces["body"]
    for sample, before in zip(sampled, plain, strict=True):
        np.testing.assert_array_equal(sample.piece.vertices, before.mesh.vertices)
        mended = mend(model, before.garment, before.body, before.offsets, before.mask)
        np.testing.assert_array_equal(sample.mesh.vertices, mended.vertices)
        assert sample.kept_share == before.kept_share
        # Its bumps are less high than those of the same cloth, and it is out of the body.
        faces = model.body_template.faces_of(before.garment)
        whole = fill_holes(before.mask, faces)
        plain_cloth = largest_piece(garment_mesh(before.body + before.offsets, faces, whole))
        np.testing.assert_array_equal(mended.faces, plain_cloth.faces)
        count = len(mended.vertices)
        rough = np.eye(count) - averaging_matrix(mended.faces, count, along_boundaries=True)
        bumps = [np.linalg.norm(rough @ mesh.vertices) for mesh in (plain_cloth, mended)]
        assert bumps[1] < 0.7 * bumps[0]
        depth = [
            BodyInside(before.body, body_faces).depth(mesh.vertices)
            for mesh in (plain_cloth, mended)
        ]
        assert (depth[1] > 2e-3).mean() <= (depth[0] > 2e-3).mean()


def test_small_holes_are_filled_and_hems_are_not():
    faces = tube_faces(False)
    ring = np.arange(VERTICES) // AROUND
    mask = (ring >= 3) & (ring < 12)
    hole = mask.copy()
    hole[6 * AROUND + np.arange(3)] = False
    np.testing.assert_array_equal(fill_holes(hole, faces), mask)
    np.testing.assert_array_equal(fill_holes(mask, faces), mask)
    parted = mask & (ring != 6)  # as of a shirt and trousers
    np.testing.assert_array_equal(fill_holes(parted, faces), parted)


def test_nothing_decoded_settles_to_nothing(model, types, monkeypatch):
    def bare(*args):
        for offsets, mask in decode_codes(*args):
            yield offsets, np.zeros_like(mask)

    monkeypatch.setattr("drapeline.models.gcvae.sample.decode_codes", bare)
    (sample,) = sample_garments(model, types, requests(1), seed=0, settle=True)
    assert not len(sample.mesh.faces)


def test_a_garment_that_is_not_sound_is_drawn_again(model, types, monkeypatch):
    asked, unsound = requests(4), set()
    monkeypatch.setattr(SampledGarment, "is_sound", lambda s, _: s.z.tobytes() not in unsound)
    first = sample_garments(model, types, asked, seed=0, settle=False)
    unsound.add(first[1].z.tobytes())
    again = sample_garments(model, types, asked, seed=0, settle=False)
    assert [sample.draws for sample in again] == [1, 2, 1, 1]
    assert [s.name for s in again] == list(asked)
    for k, (before, after) in enumerate(zip(first, again, strict=True)):
        assert np.array_equal(before.z, after.z) == (k != 1)
    monkeypatch.setattr(SampledGarment, "is_sound", lambda *_: False)
    assert {s.draws for s in sample_garments(model, types, asked, seed=0, settle=False)} == {
        _DRAWS_MAX
    }


def test_torn_garments_and_those_in_the_body_are_not_sound(model, types):
    sample = sample_garments(model, types, requests(1), seed=0, settle=False)[0]
    body_faces = model.body_template.faces["body"]
    outside = replace(sample.mesh, vertices=sample.mesh.vertices + np.float32(10))
    good = replace(sample, decoded=outside, piece=outside)
    assert good.is_sound(body_faces)
    half = Mesh(outside.vertices[: len(outside.vertices) // 2], outside.faces[:0])
    assert not replace(good, piece=half).is_sound(body_faces)
    middle = np.broadcast_to(sample.body.mean(axis=0), outside.vertices.shape)
    assert not replace(good, piece=replace(outside, vertices=middle)).is_sound(body_faces)
    nothing = Mesh(outside.vertices[:0], outside.faces[:0])
    assert not replace(good, decoded=nothing, piece=nothing).is_sound(body_faces)
