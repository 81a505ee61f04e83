"""Sampling and ways through the codes, on a network that was not even trained."""

import csv
import json
import struct
from dataclasses import replace

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.geometry.collision import resolve_penetration
from drapeline.geometry.mesh import Mesh, faces_within, load_obj
from drapeline.models.gcvae import sample as sampling
from drapeline.models.gcvae.codes import (
    Codes,
    decode_codes,
    encode_garments,
    measure_static,
    rest_body,
)
from drapeline.models.gcvae.interpolate import paper_walks, walk
from drapeline.models.gcvae.sample import (
    draw_requests,
    fit_types,
    sample_garments,
    sample_table,
    save_samples,
    wearer_mesh,
)
from drapeline.models.gcvae.vae import StaticVae
from drapeline.outfits.garment_types import GARMENTS
from drapeline.seeding import rng_for
from gcvae_files import SETTINGS, TypedGarments, shaken
from gcvae_toys import AROUND, RINGS, VERTICES, toy_domain

DRESS, TROUSERS = GARMENTS.index("Dress"), GARMENTS.index("Trousers")


@pytest.fixture(scope="module")
def garments():
    return TypedGarments()


@pytest.fixture(scope="module")
def model():
    return shaken(StaticVae(SETTINGS, toy_domain()))


def half(upper):
    """(V,) the upper or the lower half of the tube."""
    return (np.arange(VERTICES) // AROUND >= RINGS // 2) == upper


@pytest.fixture(scope="module")
def types():
    """Dresses cover the upper half, with codes about 3 in the first number; trousers the rest."""
    rng = rng_for(0, "codes")
    garment = np.repeat([DRESS, TROUSERS], 100)
    mean = rng.normal(size=(200, 5)) * 0.5
    mean[:, 0] += np.where(garment == DRESS, 3, -3)
    mask = np.stack([half(kind == DRESS) for kind in garment])
    return fit_types(Codes(mean, np.full((200, 5), -6.0)), garment, mask)


@pytest.fixture
def halves(monkeypatch):
    """A decoder whose mask is the upper half where the code's first number is positive."""

    def decoded(model, z, *rest):
        for code, (offsets, mask) in zip(z, decode_codes(model, z, *rest), strict=True):
            mask[:] = half(code[0] > 0)
            yield offsets, mask

    monkeypatch.setattr(sampling, "decode_codes", decoded)


def requests(count=4, garments=("prior", "Dress"), **changed):
    settings = {
        "female_share": 0.5,
        "shape": None,
        "shape_range": 1.0,
        "tightness": None,
        "tightness_range": (-1.5, 0.5),
    }
    return draw_requests(0, count, garments, **{**settings, **changed})


def test_codes_are_drawn_where_their_type_is(types):
    rng = rng_for(1, "draws")
    for name in ("Dress", "Trousers"):
        drawn = np.stack([types.draw(rng, name) for _ in range(300)])
        np.testing.assert_allclose(drawn.mean(0), types.mean[GARMENTS.index(name)], atol=0.15)
        np.testing.assert_allclose(drawn.std(0), 0.5, atol=0.1)
    assert types.share[[DRESS, TROUSERS]].tolist() == [0.5, 0.5]


def test_codes_are_drawn_near_those_of_garments():
    """Two kinds of dresses: none is drawn between them, where their Gaussian has its mode."""
    rng = rng_for(0, "two kinds")
    mean = rng.normal(size=(200, 5))
    mean[:, 0] = np.repeat([-3.0, 3.0], 100)
    garment = np.full(200, DRESS)
    types = fit_types(Codes(mean, np.full((200, 5), -6.0)), garment, np.ones((200, VERTICES), bool))
    drawn = np.stack([types.draw(rng, "Dress") for _ in range(1000)])
    assert (np.abs(drawn[:, 0]) < 0.5).mean() < 0.06
    np.testing.assert_allclose(drawn.std(0), mean.std(0), rtol=0.15)


def test_a_type_without_garments_is_refused_and_never_found(types):
    with pytest.raises(InputError, match="no training garment is a Top, expected one of Trousers"):
        types.draw(rng_for(0, "draws"), "Top")
    rng = rng_for(0, "anything")
    masks = rng.random((50, len(GARMENTS), VERTICES)) < 0.5
    found = types.log_likelihood(10 * rng.normal(size=(50, 5)), masks).argmax(axis=1)
    assert set(found) == {DRESS, TROUSERS}


def test_types_are_told_by_code_where_masks_agree_and_by_mask_where_codes_do(types):
    noise = rng_for(0, "noise").random((20, len(GARMENTS), VERTICES)) < 0.2
    between = np.zeros((20, 5))
    for upper, kind in ((True, DRESS), (False, TROUSERS)):
        found = types.log_likelihood(between, half(upper) ^ noise).argmax(axis=1)
        assert (found == kind).all()
        found = types.log_likelihood(np.tile(types.mean[kind], (20, 1)), noise).argmax(axis=1)
        assert (found == kind).all()


def test_a_model_without_a_mask_cannot_be_sampled(types):
    settings = replace(SETTINGS, training=replace(SETTINGS.training, mask=False))
    with pytest.raises(InputError, match="without a mask branch cannot be sampled"):
        model = StaticVae(settings, toy_domain()).eval()
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
        np.testing.assert_array_equal(sample.body, rest_body(model, sample.request.cvar))
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

    monkeypatch.setattr(sampling, "decode_codes", with_a_gap)
    sampled = sample_garments(model, types, requests(6), seed=0, settle=False)
    rows = sample_table(sampled, model.body_template.faces["body"])
    for sample, row in zip(sampled, rows, strict=True):
        assert (row["pieces_before"], row["pieces"]) == (2, 1)
        assert row["vertices"] == 10 * AROUND
        before = {tuple(v) for v in sample.decoded.vertices.tolist()}
        assert {tuple(v) for v in sample.mesh.vertices.tolist()} <= before
        assert row["kept_share"] == pytest.approx(
            len(sample.mesh.vertices) / max(len(before), 1), abs=1e-9
        )


def test_settled_garments_are_the_decoded_ones_evened_and_outside(model, types):
    asked = requests(6)
    plain = sample_garments(model, types, asked, seed=0, settle=False)
    sampled = sample_garments(model, types, asked, seed=0, settle=True)
    body_faces = model.body_template.faces["body"]
    for sample, before in zip(sampled, plain, strict=True):
        np.testing.assert_array_equal(sample.piece.vertices, before.mesh.vertices)
        np.testing.assert_array_equal(sample.mesh.faces, before.mesh.faces)
        (expected,) = resolve_penetration(
            before.mesh.vertices[None], before.mesh.faces, before.body[None], body_faces
        )
        np.testing.assert_array_equal(sample.mesh.vertices, expected)
        assert not np.allclose(expected, before.mesh.vertices, atol=1e-3)
        assert sample.kept_share == before.kept_share


def test_nothing_decoded_settles_to_nothing(model, types, monkeypatch):
    def bare(*args):
        for offsets, mask in decode_codes(*args):
            yield offsets, np.zeros_like(mask)

    monkeypatch.setattr(sampling, "decode_codes", bare)
    (sample,) = sample_garments(model, types, requests(1), seed=0, settle=True)
    assert not len(sample.mesh.faces)


def test_a_garment_that_is_not_sound_is_drawn_again(model, types, monkeypatch):
    asked, unsound = requests(4), set()
    monkeypatch.setattr(sampling.Sampled, "sound", lambda s, _: s.z.tobytes() not in unsound)
    first = sample_garments(model, types, asked, seed=0, settle=False)
    unsound.add(first[1].z.tobytes())
    again = sample_garments(model, types, asked, seed=0, settle=False)
    assert [sample.draws for sample in again] == [1, 2, 1, 1]
    assert [s.name for s in again] == list(asked)
    for k, (before, after) in enumerate(zip(first, again, strict=True)):
        assert np.array_equal(before.z, after.z) == (k != 1)
    monkeypatch.setattr(sampling.Sampled, "sound", lambda *_: False)
    assert {s.draws for s in sample_garments(model, types, asked, seed=0, settle=False)} == {
        sampling._DRAWS
    }


def test_torn_garments_and_those_in_the_body_are_not_sound(model, types):
    sample = sample_garments(model, types, requests(1), seed=0, settle=False)[0]
    body_faces = model.body_template.faces["body"]
    outside = replace(sample.mesh, vertices=sample.mesh.vertices + np.float32(10))
    good = replace(sample, decoded=outside, piece=outside)
    assert good.sound(body_faces)
    half = Mesh(outside.vertices[: len(outside.vertices) // 2], outside.faces[:0])
    assert not replace(good, piece=half).sound(body_faces)
    middle = np.broadcast_to(sample.body.mean(axis=0), outside.vertices.shape)
    assert not replace(good, piece=replace(outside, vertices=middle)).sound(body_faces)
    nothing = Mesh(outside.vertices[:0], outside.faces[:0])
    assert not replace(good, decoded=nothing, piece=nothing).sound(body_faces)


def test_saved_samples_can_be_opened(model, types, toy_body, tmp_path):
    bodies = dict.fromkeys(GENDERS, toy_body)
    sampled = sample_garments(model, types, requests(3), seed=0, settle=False)
    save_samples(tmp_path / "out", sampled, bodies, model.body_template.faces["body"])
    names = {p.name for p in (tmp_path / "out").iterdir()}
    assert names == {f"0000{i}.{e}" for i in (1, 2, 3) for e in ("obj", "glb")} | {
        "samples.tsv",
        "codes.npz",
    }
    with open(tmp_path / "out/samples.tsv") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t"))
    for sample, row in zip(sampled, rows, strict=True):
        mesh = load_obj(tmp_path / "out" / f"{sample.name}.obj")
        np.testing.assert_allclose(mesh.vertices, sample.mesh.vertices, atol=1e-6)
        assert int(row["vertices"]) == len(mesh.vertices)
    data = (tmp_path / "out/00001.glb").read_bytes()
    (length,) = struct.unpack("<I", data[12:16])
    meshes = json.loads(data[20 : 20 + length])["meshes"]
    assert [m["name"] for m in meshes] == ["Body", sampled[0].garment]


def test_a_wearer_between_the_genders_is_between_their_bodies(toy_body):
    bodies = {"female": toy_body, "male": replace(toy_body, v_template=1.2 * toy_body.v_template)}
    cvar = np.zeros(13)
    made = []
    for gender in (0, 0.5, 1):
        cvar[10] = gender
        made.append(wearer_mesh(bodies, cvar).vertices)
    np.testing.assert_allclose(made[1], (made[0] + made[2]) / 2, atol=1e-6)
    assert not np.allclose(made[0], made[2])


def test_codes_do_not_depend_on_the_batch(model, garments):
    rows = np.arange(40)
    codes = encode_garments(model, garments, rows)
    some = encode_garments(model, garments, rows[[30, 3, 17]])
    np.testing.assert_allclose(some.mean, codes.mean[[30, 3, 17]], atol=1e-5)
    assert codes.log_variance.shape == (40, 5)


def test_measures_are_those_of_the_network(model, garments):
    """The metrics of a whole split agree with what Lightning logs in validation, batch by batch."""
    rows = garments.rows("test")
    codes = encode_garments(model, garments, rows)
    measures = measure_static(model, garments, rows, codes)
    import torch

    batch = {
        k: torch.from_numpy(v) if isinstance(v, np.ndarray) else v
        for k, v in garments.batch(rows).items()
    }
    offsets, mask = model.decode(model.encode(batch).mean, batch["cvar"], batch["topology"])
    true = batch["mask"]
    error = (offsets.detach() - batch["offsets"]).norm(dim=2)
    for i, row in enumerate(measures):
        assert row["surface_error_mm"] == pytest.approx(
            1000 * error[i][true[i]].mean().item(), rel=1e-4
        )
        seen = mask[i] > 0.5
        both, either = (seen & true[i]).sum(), (seen | true[i]).sum()
        assert row["mask_iou"] == pytest.approx((both / either).item(), abs=1e-6)
        assert row["kl_nat"] > 0


def test_a_walk_begins_and_ends_at_its_garments(model, types, garments):
    rows = garments.rows("test")
    codes = encode_garments(model, garments, rows)
    start, end = ((codes.mean[i], garments.cvar(rows)[i]) for i in (0, 1))
    steps = walk(model, types, start, end, 5)
    np.testing.assert_allclose(
        [s.cvar for s in (steps[0], steps[-1])], [start[1], end[1]], atol=1e-6
    )
    np.testing.assert_allclose(steps[2].cvar, (start[1] + end[1]) / 2, atol=1e-6)


def test_a_walk_across_types_changes_topology_where_the_mask_does(model, types, halves):
    start, end = types.mean[TROUSERS], types.mean[DRESS]
    cvar = np.zeros(13)
    steps = walk(model, types, (start, cvar), (end, cvar), 8)
    assert [step.type for step in steps] == [TROUSERS] * 4 + [DRESS] * 4
    for step in steps:
        faces = model.body_template.faces["skirt" if step.type == DRESS else "body"]
        assert len(step.garment.faces) == len(faces_within(faces, half(step.type == DRESS)))


def test_paper_walks_change_what_they_say(model, types, garments):
    rows = garments.rows("test")
    codes = encode_garments(model, garments, rows)
    ways = paper_walks(model, types, garments, rows, codes, 4)
    assert list(ways) == ["shape", "tightness", "cloth", "topology", "all"]
    spans = {name: np.ptp([s.cvar for s in steps], axis=0) for name, steps in ways.items()}
    assert (spans["shape"][:2] == 5).all()
    assert (spans["shape"][10:] == 0).all()
    assert (spans["tightness"][:11] == 0).all()
    assert (spans["tightness"][11:] == 2).all()
    assert (spans["cloth"] == 0).all()
    assert (spans["topology"] == 0).all()
    tops = rows[garments.garment[rows] == GARMENTS.index("Top")]
    few = paper_walks(model, types, garments, tops, encode_garments(model, garments, tops), 3)
    assert few == {}
