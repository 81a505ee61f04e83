"""fabrics.md is what docs/make_fabrics.py makes of the fabrics, and they drape as real cloth."""

import importlib.util
from pathlib import Path

import pytest

from drapeline.outfits.fabrics import MEASURED_FABRICS

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def make():
    spec = importlib.util.spec_from_file_location("make_fabrics", ROOT / "docs/make_fabrics.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_values_are_those_of_the_table(make):
    page = make.PAGE.read_text()
    assert make.replace_block(page, "values", make.value_rows()) == page, "run `make docs`"


def drape_rows(make):
    block = make.PAGE.read_text().split("<!-- drape -->")[1].split("<!-- end -->")[0]
    rows = [line.strip("| ").split(" | ") for line in block.strip().splitlines()[2:]]
    return {cells[0].strip("`"): cells[1:] for cells in rows}


def test_every_fabric_was_hung_and_drapes_as_real_cloth_at_one_centimetre(make):
    """By the fast solver; the page has both."""
    rows = drape_rows(make)
    assert tuple(rows) == MEASURED_FABRICS
    for name, (low, high) in make.PUBLISHED.items():
        assert low <= float(rows[name][1]) <= high, name
