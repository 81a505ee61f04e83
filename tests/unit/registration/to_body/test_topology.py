"""The second topology, smoothing of the inner legs, and the segments."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from drapeline.bodies.model import posed_vertices
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import boundary_loops, edge_counts, half_edges
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.super_body import build_super_body
from drapeline.registration.to_body.topology import (
    Smoother,
    build_topology,
    load_topology,
    save_topology,
    skirt_body,
    skirt_topology,
    topology_codes,
)
from toys.topology import flat_sheet, piece_count, section


def test_legs_become_one_tube(made):
    _, topology = made
    faces, count = topology.skirt_faces, len(topology.rest)
    pairs, sides = edge_counts(faces)
    assert sides.max() == 2
    half = half_edges(faces)
    assert len(np.unique(half, axis=0)) == len(half)  # neighbours agree on the outside
    np.testing.assert_array_equal(np.unique(faces), np.arange(count))
    assert count - len(pairs) + len(faces) == 2 - 4  # a sphere with four holes
    assert piece_count(pairs, count) == 1
    loops = boundary_loops(faces)
    assert len(loops) == 4
    hem = min(loops, key=lambda loop: topology.rest[loop, 2].mean())
    assert (topology.rest[hem, 0] > 0.05).any()
    assert (topology.rest[hem, 0] < -0.05).any()


def test_only_the_inner_line_of_the_legs_differs(made):
    _, topology = made
    ours = {tuple(sorted(f)) for f in topology.faces.tolist()}
    theirs = {tuple(sorted(f)) for f in topology.skirt_faces.tolist()}
    added = {tuple(sorted(f)) for f in topology.skirt_faces[-int(topology.joining) :].tolist()}
    assert theirs - ours == added
    x = topology.rest[np.array(sorted(added)), 0]
    assert (x.max(axis=1) > 0).any()
    assert (np.ptp(np.sign(x), axis=1) > 0).mean() > 0.9  # they lead from one leg to the other
    removed = np.unique(np.array(sorted(ours - theirs)))
    assert topology.rest[removed, 2].max() < 0
    assert set(removed.tolist()) <= set(np.flatnonzero(topology.inner_leg).tolist())


def test_smoothed_vertices_lie_on_the_mean_of_their_neighbours(made):
    refined, topology = made
    shape = np.random.default_rng(5).uniform(-3, 3, 10)
    body = posed_vertices(refined.bodies["male"], shape, REST_POSE[None])[0][0]
    tube = skirt_body(topology, body)
    assert tube.dtype == body.dtype
    fixed = ~topology.inner_leg
    np.testing.assert_array_equal(tube[fixed], body[fixed])
    assert np.abs(tube - body).max() > 0.02
    pairs, sides = edge_counts(topology.skirt_faces)
    hem = set(pairs[sides == 1].ravel().tolist())
    near = {}
    for (a, b), side in zip(pairs.tolist(), sides.tolist(), strict=True):
        for start, end in ((a, b), (b, a)):
            if start not in hem or side == 1:
                near.setdefault(start, []).append(end)
    for vertex in np.flatnonzero(topology.inner_leg).tolist():
        np.testing.assert_allclose(tube[vertex], tube[near[vertex]].mean(axis=0), atol=1e-5)


@pytest.mark.parametrize("height", [-0.35, -0.55, -0.75])
def test_a_cut_through_the_smoothed_legs_is_nearly_convex(made, height):
    _, topology = made
    rest = topology.rest.astype(np.float64)
    tube = skirt_body(topology, rest)

    def filled(vertices):
        points, area = section(vertices, topology.skirt_faces, height)
        return area / ConvexHull(points).volume

    assert filled(tube) > 0.95
    assert filled(rest) < 0.9


def test_a_body_whose_legs_end_too_soon_is_refused(made):
    _, topology = made
    with pytest.raises(ValueError, match="no strip of faces"):
        skirt_topology(topology.rest.astype(float), topology.faces, hips=-0.5)


def test_smoothing_draws_a_sheet_tight_between_what_is_held():
    """A linear function is harmonic: the bulge goes, and every vertex finds its place again."""
    sheet, faces = flat_sheet(9, 9, 0.1)
    sheet[:, 2] = 0.3 * sheet[:, 0] - 0.2 * sheet[:, 1]
    inner = (np.abs(sheet[:, :2] - 0.4) < 0.35).all(axis=1)
    bulging = sheet + np.random.default_rng(0).normal(0, 0.05, sheet.shape) * inner[:, None]
    smooth = Smoother(faces, inner)(bulging)
    np.testing.assert_array_equal(smooth[~inner], sheet[~inner])
    np.testing.assert_allclose(smooth, sheet, atol=1e-12)


def test_smoothing_leaves_a_hem_as_a_line():
    """Its vertices spread along the boundary, and are not drawn into the sheet."""
    sheet, faces = flat_sheet(9, 5, 0.1)
    hem = (sheet[:, 1] == 0) & (sheet[:, 0] > 0) & (sheet[:, 0] < 0.79)
    crowded = sheet.copy()
    crowded[hem, 0] **= 2
    smooth = Smoother(faces, hem)(crowded)
    np.testing.assert_allclose(smooth, sheet, atol=1e-12)


def test_garments_choose_their_topology(made):
    _, topology = made
    for garment in ("Tshirt", "Top", "Trousers", "Jumpsuit"):
        assert topology.faces_of(garment) is topology.faces
    for garment in ("Skirt", "Dress"):
        assert topology.faces_of(garment) is topology.skirt_faces


def test_legs_that_cannot_be_joined_name_the_body(made):
    refined, _ = made
    female = refined.bodies["female"]
    joints = female.J_regressor.copy()
    joints[[1, 2]] = joints[[4, 5]]  # hip joints at the knees: no legs meet below them
    kneeling = replace(female, J_regressor=joints, name="kneeling")
    with pytest.raises(InputError, match="kneeling: no strip of faces .* expected two legs apart"):
        build_topology(replace(refined, bodies={"female": kneeling}))


def test_a_saved_topology_loads_as_it_was(made, tmp_path):
    _, topology = made
    save_topology(tmp_path / "topology.npz", topology)
    loaded = load_topology(tmp_path / "topology.npz")
    for field in fields(topology):
        np.testing.assert_array_equal(getattr(loaded, field.name), getattr(topology, field.name))
    np.testing.assert_array_equal(
        skirt_body(loaded, loaded.rest), skirt_body(topology, topology.rest)
    )
    with pytest.raises(InputError, match="other.npz: no such file"):
        load_topology(tmp_path / "other.npz")


def test_the_real_bodies_legs_are_joined_by_flat_sheets(baked_bodies):
    topology = build_topology(build_super_body(baked_bodies, 6000))
    tube = skirt_body(topology, topology.rest.astype(np.float64))
    assert len(boundary_loops(topology.skirt_faces)) == 4
    for height in (-0.3, -0.5, -0.7):
        points, area = section(tube, topology.skirt_faces, height)
        assert area / ConvexHull(points).volume > 0.95


def test_skirts_and_dresses_have_the_second_topology():
    codes = topology_codes(np.arange(len(GARMENTS)))
    assert [g for g, c in zip(GARMENTS, codes, strict=True) if c] == ["Skirt", "Dress"]
