"""Both recipes install what drapeline needs by `make setup`, and so do the docs."""

import re
from pathlib import Path

import pytest

from drapeline.preflight import SYSTEM_LIBRARIES
from toys.snakemake_run import PARTS

ROOT = Path(__file__).parents[2]
RECIPES = ["Containerfile", "drapeline.def"]


@pytest.mark.parametrize("name", [*RECIPES, "docs/how-to/install.md"])
def test_every_library_that_blender_needs_is_installed(name):
    installed = re.findall(r"apt-get install ((?:.*\\\n)*.*)", (ROOT / name).read_text())
    packages = {word for line in installed for word in line.replace("\\", " ").split()}
    assert packages >= {"make", *SYSTEM_LIBRARIES.values()}


@pytest.mark.parametrize("name", RECIPES)
def test_the_rest_is_the_steps_of_make(name):
    text = (ROOT / name).read_text()
    assert "make setup" in text
    assert "pip install" not in text
    assert re.search(r"^setup: \.venv/ready$", (ROOT / "Makefile").read_text(), re.MULTILINE)


def test_both_recipes_begin_with_the_same_image_of_the_right_python():
    images = {
        re.search(r"^F(?:rom:|ROM) (.*)$", (ROOT / name).read_text(), re.M)[1] for name in RECIPES
    }
    assert len(images) == 1
    assert "python:3.11" in images.pop()


def test_apptainer_copies_all_that_a_run_reads():
    block = (ROOT / "drapeline.def").read_text().split("%files\n")[1].split("\n\n")[0]
    copied = {line.split()[0] for line in block.splitlines()}
    assert copied >= {*PARTS, "Makefile", "pyproject.toml", "requirements.lock"} - {"tests/data"}
    for name in copied:
        assert (ROOT / name).exists()
