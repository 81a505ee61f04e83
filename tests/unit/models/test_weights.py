"""The models that come with drapeline."""

import subprocess
import sys

import numpy as np
import pytest

import drapeline
from drapeline.frames import REST_POSE
from drapeline.models.start import package_root
from drapeline.models.training.module import BEST
from toys.snakemake_run import ROOT

NAMES = sorted(
    path.parent.relative_to(package_root()).as_posix() for path in package_root().rglob(BEST)
)
SHAPE = np.zeros(10)


def test_they_are_those_that_the_documentation_names():
    text = (ROOT / "docs/reference/api.md").read_text()
    assert NAMES
    assert all(f"`{name}`" in text for name in NAMES)


def test_they_are_small_and_each_has_a_card():
    assert sum(path.stat().st_size for path in package_root().rglob("*")) < 30e6
    for name in NAMES:
        assert "## On the test split" in (package_root() / name / "README.md").read_text()


@pytest.mark.parametrize("garment", ["Skirt", "Tshirt", "Trousers", "Top", "Dress", "Jumpsuit"])
def test_one_draws_garments_around_their_wearer(garment):
    (drawn,) = drapeline.load("gcvae").sample(1, garment, gender="female", shape=SHAPE, seed=2)
    assert drawn.garment == garment
    assert len(drawn.mesh.vertices) > 500
    low, high = drawn.body.vertices.min(axis=0), drawn.body.vertices.max(axis=0)
    assert (drawn.mesh.vertices > low - 0.3).all()
    assert (drawn.mesh.vertices < high + 0.3).all()


@pytest.fixture
def points():
    """Somebody who stands still and wears nothing, as clouds."""
    body = drapeline.load("gcvae").sample(1, "Top", gender="female", shape=SHAPE, seed=2)[0].body
    return np.repeat(body.vertices[None, ::3], 12, axis=0)


def test_labels_of_bare_skin_are_skin(points):
    poses = np.repeat(REST_POSE[None], len(points), axis=0)
    codes = drapeline.load("labels").label(points, poses, SHAPE, gender="female")
    assert codes.shape == points.shape[:2]
    assert (codes == 0).mean() > 0.9


def test_loading_one_needs_no_workflow():
    code = (
        "import sys\n"
        "class Banned:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name.split('.')[0] in {'snakemake', 'bpy', 'pandas', 'lightning'}:\n"
        "            raise ImportError(name)\n"
        "sys.meta_path.insert(0, Banned())\n"
        "import drapeline\n"
        "for name in sys.argv[1:]:\n"
        "    drapeline.load(name)\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, *NAMES], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr[-800:]
