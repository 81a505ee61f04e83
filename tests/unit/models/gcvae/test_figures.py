"""Held-out garments and transitions as figures show them."""

from types import SimpleNamespace

import numpy as np

from drapeline.geometry.mesh import faces_within
from drapeline.models.gcvae import figures
from drapeline.models.gcvae.codec import Codes, encode_garments
from drapeline.models.gcvae.figures import ends_of_figure_9, interpolate
from drapeline.outfits.garment_types import GARMENTS
from drapeline.seeding import rng_for
from toys.gcvae import DRESS, TROUSERS, half


class Frames:
    """Two hundred frames of two garments; the last fifty are held out."""

    data = SimpleNamespace(
        garment_index=np.repeat([0, 1], 100),
        garment=np.array([GARMENTS.index("Skirt"), GARMENTS.index("Tshirt")]),
    )

    def rows(self, split):
        return np.arange(150) if split == "train" else np.arange(150, 200)


def test_wrinkle_codes_are_spread_like_those_of_training_frames_of_the_type(monkeypatch):
    rng = rng_for(0, "codes")
    known = np.where(Frames.data.garment_index[:, None], 5.0, -5.0) + rng.standard_normal((200, 8))
    seen = []

    def encoded(model, garments, rows):
        seen.extend(rows)
        return Codes(known[rows], np.zeros((len(rows), 8)))

    monkeypatch.setattr(figures, "encode_garments", encoded)
    for name, expected in (("Skirt", range(100)), ("Tshirt", range(100, 150))):
        seen.clear()
        drawn = figures._wrinkle_codes(rng, None, Frames(), name, 400)
        assert drawn.shape == (400, 8)
        assert set(seen) <= set(expected)
        own = known[list(expected)]
        np.testing.assert_allclose(drawn.mean(axis=0), own.mean(axis=0), atol=0.2)
        np.testing.assert_allclose(drawn.std(axis=0), own.std(axis=0), rtol=0.2)
    seen.clear()
    figures._wrinkle_codes(rng, None, Frames(), "Dress", 2)  # no training frame wears one
    assert set(seen) <= set(range(150))


def test_a_walk_begins_and_ends_at_its_garments(model, types, garments):
    rows = garments.rows("test")
    codes = encode_garments(model, garments, rows)
    start, end = ((codes.mean[i], garments.cvar(rows)[i]) for i in (0, 1))
    steps = interpolate(model, types, start, end, 5)
    np.testing.assert_allclose(
        [s.cvar for s in (steps[0], steps[-1])], [start[1], end[1]], atol=1e-6
    )
    np.testing.assert_allclose(steps[2].cvar, (start[1] + end[1]) / 2, atol=1e-6)


def test_a_walk_across_types_changes_topology_where_the_mask_does(model, types, halves):
    start, end = types.mean[TROUSERS], types.mean[DRESS]
    cvar = np.zeros(13)
    steps = interpolate(model, types, (start, cvar), (end, cvar), 8)
    assert [step.garment for step in steps] == ["Trousers"] * 4 + ["Dress"] * 4
    for step in steps:
        faces = model.body_template.faces["skirt" if step.garment == "Dress" else "body"]
        assert len(step.mesh.faces) == len(faces_within(faces, half(step.garment == "Dress")))


def test_paper_walks_change_what_they_say(model, garments):
    rows = garments.rows("test")
    codes = encode_garments(model, garments, rows)
    ends = ends_of_figure_9(garments, rows, codes)
    assert list(ends) == ["shape", "tightness", "cloth", "topology", "all"]
    spans = {name: np.abs(end[1] - start[1]) for name, (start, end) in ends.items()}
    assert (spans["shape"][:2] == 5).all()
    assert (spans["shape"][10:] == 0).all()
    assert (spans["tightness"][:11] == 0).all()
    assert (spans["tightness"][11:] == 2).all()
    assert (spans["cloth"] == 0).all()
    assert (spans["topology"] == 0).all()
    tops = rows[garments.garment[rows] == GARMENTS.index("Top")]
    assert ends_of_figure_9(garments, tops, encode_garments(model, garments, tops)) == {}
