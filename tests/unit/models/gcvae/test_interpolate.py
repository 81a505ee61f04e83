import numpy as np

from drapeline.geometry.mesh import faces_within
from drapeline.models.gcvae.codec import encode_garments
from drapeline.models.gcvae.figures import interpolate, interpolate_as_figure_9
from drapeline.outfits.garment_types import GARMENTS
from toys.gcvae import DRESS, TROUSERS, half


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


def test_paper_walks_change_what_they_say(model, types, garments):
    rows = garments.rows("test")
    codes = encode_garments(model, garments, rows)
    ways = interpolate_as_figure_9(model, types, garments, rows, codes, 4)
    assert list(ways) == ["shape", "tightness", "cloth", "topology", "all"]
    spans = {name: np.ptp([s.cvar for s in steps], axis=0) for name, steps in ways.items()}
    assert (spans["shape"][:2] == 5).all()
    assert (spans["shape"][10:] == 0).all()
    assert (spans["tightness"][:11] == 0).all()
    assert (spans["tightness"][11:] == 2).all()
    assert (spans["cloth"] == 0).all()
    assert (spans["topology"] == 0).all()
    tops = rows[garments.garment[rows] == GARMENTS.index("Top")]
    few = interpolate_as_figure_9(
        model, types, garments, tops, encode_garments(model, garments, tops), 3
    )
    assert few == {}
