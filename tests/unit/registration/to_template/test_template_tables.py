"""Files of garments registered to templates."""

import csv

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.registration.error_table import FILE_NAME
from drapeline.registration.settings import TemplateFitSettings
from drapeline.registration.to_template.remesh_table import load_tables, remesh
from drapeline.registration.to_template.template_tables import NamedGarment, write_tables
from toys.templates import toy_skirt, toy_template


@pytest.fixture(scope="module")
def template():
    return toy_template()


@pytest.fixture
def folder(tmp_path, template):
    garments = [
        NamedGarment("s1", "Skirt", *toy_skirt(0.25, -0.4)),
        NamedGarment("s1", "Top", *toy_skirt(0.1, -0.4)),
        NamedGarment("s2", "Skirt", *toy_skirt(0.2, -0.7, around=26)),
    ]
    settings = TemplateFitSettings(iterations=3)
    assert write_tables(tmp_path / "fits", garments, {"Skirt": template}, settings) == 2
    return tmp_path / "fits"


def test_tables_carry_every_garment_of_a_type_and_its_residuals(folder, template):
    tables = load_tables([folder], "Skirt")
    assert set(tables) == {"s1", "s2"}
    for name, radius, low, around in (("s1", 0.25, -0.4, 20), ("s2", 0.2, -0.7, 26)):
        vertices, _ = toy_skirt(radius, low, around=around)
        new = remesh(vertices, tables[name])
        assert new.shape == template.vertices.shape
        assert new[:, 2].min() == pytest.approx(low, abs=1e-3)
        assert new[:, 2].max() == pytest.approx(0, abs=1e-3)
    with open(folder / FILE_NAME, newline="") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t"))
    assert {(row["garment"], row["name"]) for row in rows} == {("Skirt", "s1"), ("Skirt", "s2")}
    assert {row["unit"] for row in rows if row["metric"].endswith("_mm")} == {"mm"}
    assert {row["value"] for row in rows if row["metric"] == "flipped_faces"} == {"0"}


def test_a_garment_without_an_opening_is_named(tmp_path, template):
    vertices, faces = toy_skirt(0.2, -0.5)
    closed = np.concatenate([faces, [[k, 0, (k + 1) % 20] for k in range(1, 19)]])
    with pytest.raises(InputError, match=r"s7/Skirt: the garment has no (waist|hem)"):
        write_tables(
            tmp_path / "fits",
            [NamedGarment("s7", "Skirt", vertices, closed)],
            {"Skirt": template},
            TemplateFitSettings(),
        )
    assert not (tmp_path / "fits").exists()
