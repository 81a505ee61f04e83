"""Templates in their files, and which of their openings is which."""

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.registration.to_template.garment_template import (
    LOOP_NAMES,
    load_template,
    named_loops,
)
from toys.templates import toy_template


def test_a_template_survives_its_file(tmp_path):
    template = toy_template()
    template.save(tmp_path / "t.npz")
    loaded = load_template(tmp_path / "t.npz")
    for name in ("vertices", "faces", "loop"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(template, name))
    assert loaded.loop_names == template.loop_names


def test_a_file_without_its_openings_is_refused(tmp_path):
    np.savez(tmp_path / "t.npz", vertices=np.zeros((3, 3)), faces=np.array([[0, 1, 2]]))
    with pytest.raises(InputError, match=r"t\.npz.*loop"):
        load_template(tmp_path / "t.npz")


# Where the middles of a type's openings are, in a rest pose with arms and legs apart.
PLACES = {
    "Skirt": {"waist": (0, 0, 0), "hem": (0, 0, -0.5)},
    "Tshirt": {
        "neck": (0, 0, 0.5),
        "hem": (0, 0, -0.1),
        "left_cuff": (0.4, 0, 0.3),
        "right_cuff": (-0.4, 0, 0.3),
    },
    "Trousers": {"waist": (0, 0, 0), "left_cuff": (0.3, 0, -0.9), "right_cuff": (-0.3, 0, -0.9)},
}


@pytest.mark.parametrize("garment", PLACES)
def test_openings_are_told_apart_in_whatever_order_they_come(garment):
    places = PLACES[garment]
    points = np.array([*places.values()], dtype=float)
    loops = [np.array([index]) for index in range(len(points))]
    for turn in range(len(loops)):
        found = named_loops(points, loops[turn:] + loops[:turn], LOOP_NAMES[garment])
        assert {name: ids.tolist() for name, ids in found.items()} == {
            name: [index] for index, name in enumerate(places)
        }


def test_openings_that_are_missing_are_left_out():
    points = np.array([[0, 0, 1.0], [0, 0, 0]])
    assert named_loops(points, [np.array([0])], ("waist", "hem")) == {"waist": np.array([0])}
    found = named_loops(points, [np.array([1]), np.array([0])], ("waist", "hem"))
    assert {name: ids.tolist() for name, ids in found.items()} == {"waist": [0], "hem": [1]}
