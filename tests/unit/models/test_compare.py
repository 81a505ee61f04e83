"""The comparison of all models, with representations whose error is known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from drapeline.geometry.mesh import Mesh
from drapeline.metrics.table import ALL
from drapeline.models import compare as compare_module
from drapeline.models import contract
from drapeline.models.compare import (
    REPRESENTATION,
    compare_representations,
    held_out_garments,
)
from drapeline.models.contract import HeldOutGarment
from drapeline.outfits.garment_types import GARMENTS
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.outfits.static import StaticOutfit
from toys.metric_rows import find_value

NONE = np.zeros((0, 3), dtype=np.float32)


def sheet(width):
    """Two triangles, so small that their rounding is far below what is asked."""
    corners = np.float32([[0, 0, 0], [width, 0, 0], [width, 1, 0], [0, 1, 0]])
    return Mesh(corners / 16, np.int32([[0, 1, 2], [0, 2, 3]]))


class Raised:
    """Every garment a given height above itself."""

    def __init__(self, variant, height_m, numbers=None):
        self.variant, self.height_m, self.numbers = variant, height_m, numbers

    def rebuild(self, garments):
        for garment in garments:
            yield replace(garment.mesh, vertices=garment.mesh.vertices + [0, 0, self.height_m])

    def code_numbers(self, garment):
        return self.numbers


def compare(representations, count=4):
    garments = [
        HeldOutGarment(row, f"s{row:05d}", ("Skirt", "Tshirt")[row % 2], sheet(1 + row))
        for row in range(count)
    ]
    return compare_representations(garments, representations, split="test", seed=3)


def rows_of(representations):
    return compare(representations)[0]


def test_distances_are_those_of_the_rebuilt_garments_both_ways():
    rows = rows_of([Raised("exact", 0.0), Raised("raised", 0.02, numbers=7)])
    assert {(row.model, row.split, row.seed) for row in rows.itertuples()} == {
        (REPRESENTATION, "test", 3)
    }
    for metric in ("surface_to_true_mm", "true_to_surface_mm"):
        for variant, distance in (("exact", 0), ("raised", 20)):
            for garment, n in ((ALL, 4), ("Skirt", 2), ("Tshirt", 2)):
                row = find_value(rows, variant, "test", garment, metric)
                assert row.value == pytest.approx(distance, abs=1e-4)
                assert row.n == n


def test_normals_and_openings_of_rebuilt_garments_are_measured():
    rows = rows_of([Raised("raised", 0.02)])
    for metric, expected in (("normal_error_deg", 0), ("openings_right", 1)):
        row = find_value(rows, "raised", "test", ALL, metric)
        assert row.value == pytest.approx(expected, abs=1e-3)


class Slow(Raised):
    """Takes some seconds for all garments, and some more for each."""

    def __init__(self, clock, variant, first_s, each_s):
        super().__init__(variant, 0.0)
        self.clock, self.first_s, self.each_s = clock, first_s, each_s

    def rebuild(self, garments):
        self.clock.now += self.first_s
        for mesh in super().rebuild(garments):
            self.clock.now += self.each_s
            yield mesh


def test_costs_are_what_each_representation_takes_and_not_its_measures(monkeypatch):
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(contract, "process_time", lambda: clock.now)
    measure = compare_module.mesh_measures

    def measure_slowly(*meshes):
        clock.now += 100
        return measure(*meshes)

    monkeypatch.setattr(compare_module, "mesh_measures", measure_slowly)
    _, costs = compare([Slow(clock, "all_at_once", 8, 0), Slow(clock, "each", 0, 3)])
    assert [one[:4] for one in costs] == [
        (REPRESENTATION, "all_at_once", 2, 4),
        (REPRESENTATION, "each", 3, 4),
    ]
    assert all(one.megabytes > 1 for one in costs)


def test_only_a_code_has_a_size():
    rows = rows_of([Raised("exact", 0.0), Raised("raised", 0.02, numbers=7)])
    assert find_value(rows, "raised", "test", ALL, "code_numbers").value == 7
    assert find_value(rows, "exact", "test", ALL, "code_numbers") is None


def test_a_representation_has_the_same_rows_whatever_it_is_compared_with():
    """So that each model may be measured in a job of its own."""
    both = rows_of([Raised("exact", 0.0), Raised("raised", 0.02)])
    alone = rows_of([Raised("raised", 0.02)])
    raised = both[both["variant"] == "raised"].reset_index(drop=True)
    pd.testing.assert_frame_equal(raised, alone)


def test_a_representation_that_leaves_a_garment_out_or_adds_one_is_refused():
    class Other(Raised):
        def __init__(self, chosen):
            super().__init__("other", 0.0)
            self.chosen = chosen

        def rebuild(self, garments):
            return super().rebuild([garments[k] for k in self.chosen])

    for chosen, reason in (([0, 1, 2], "shorter"), ([0, 1, 2, 3, 3], "longer")):
        with pytest.raises(ValueError, match=reason):
            compare([Other(chosen)])


def test_garments_are_those_of_the_split_and_the_types_as_they_were_made():
    data = SimpleNamespace(
        garment=np.array([GARMENTS.index(name) for name in ("Skirt", "Top", "Dress", "Skirt")]),
        outfit=np.array(["s1", "s1", "s2", "s3"]),
        rows=lambda split: np.array([0, 1, 2] if split == "test" else [3]),
    )
    quads = np.array([[0, 1, 2, 3]])
    worn = {
        outfit: Outfit(
            tuple(
                Garment(name, sheet(width).vertices, quads, *5 * [NONE])
                for width, name in enumerate(names, 1)
            ),
            *(np.zeros(10), np.zeros(2), np.zeros(2), "female"),
        )
        for outfit, names in (("s3", ["Skirt"]), ("s2", ["Dress"]), ("s1", ["Top", "Skirt"]))
    }
    outfits = [StaticOutfit(name, "test", outfit) for name, outfit in worn.items()]
    found = held_out_garments(data, outfits, ["Skirt", "Dress"], "test")
    assert [(one.row, one.outfit, one.garment) for one in found] == [
        (0, "s1", "Skirt"),
        (2, "s2", "Dress"),
    ]
    assert found[0].mesh.faces.shape == (2, 3)
    assert found[0].mesh.vertices.max() == 0.125
    assert found[1].mesh.vertices.max() == 0.0625
