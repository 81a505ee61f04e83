"""The second topology, smoothing of the inner legs, and the segments."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from drapeline.errors import InputError
from drapeline.geometry.mesh import boundary_loops
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.super_body import build_super_body
from drapeline.registration.to_body.topology import (
    build_topology,
    load_topology,
    save_topology,
    skirt_body,
    topology_codes,
)
from toys.topology import section


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
