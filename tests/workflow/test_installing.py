"""What `pip install .` gives, without and with its extras, in an environment that holds no more."""

import ast
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from drapeline.bodies.model import save_body
from gcvae_files import TypedGarments, save_model
from tiny_sample import write_tiny_sample

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "src" / "drapeline"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
READ = """
import sys, warnings
warnings.simplefilter("error")
from drapeline.bodies.model import load_body
from drapeline.dataset.reader import Cloth3D
folder, body = sys.argv[1:]
data = Cloth3D(folder, bodies=dict.fromkeys(("female", "male"), load_body(body)))
with data[0] as sample:
    assert sample.vertices("Skirt", 0, 2).shape == (2, 80, 3)
    assert sample.mesh("Skirt").triangles.shape[1] == 3
    assert sample.body_vertices(1, 2).shape[0] == 1
"""
TORCH = """
import sys
from drapeline.dataset.reader import Cloth3D
from drapeline.models.load import load
from drapeline.torch import FrameDataset, make_loader
folder, model = sys.argv[1:]
(batch,) = make_loader(FrameDataset(Cloth3D(folder)), 99, seed=0)
assert set(batch.garment) == {"Skirt", "Tshirt"}
(garment,) = load(model).sample(1)
assert len(garment.body.faces)
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Built from a copy, without asking the network."""
    folder = tmp_path_factory.mktemp("wheel")
    shutil.copytree(PACKAGE, folder / "src" / "drapeline")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder)
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-index", "--no-deps"]
    subprocess.run([*pip, "--no-build-isolation", "-w", "out", "."], cwd=folder, check=True)
    (path,) = (folder / "out").glob("*.whl")
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory, toy_body):
    """A sample, a body and a trained model."""
    folder = tmp_path_factory.mktemp("files")
    tiny = write_tiny_sample(folder, toy_body)
    save_model(folder / "model", garments=TypedGarments())
    save_body(folder / "body.npz", toy_body)
    return {"samples": tiny.folder.parent, "model": folder / "model", "body": folder / "body.npz"}


def distributions(requirements):
    """Names of distributions that pip would install for requirements, in this environment."""
    found, waiting = set(), [Requirement(text) for text in requirements]
    while waiting:
        one = waiting.pop()
        name = one.name.lower().replace("_", "-")
        if name == "drapeline":
            waiting += [Requirement(text) for extra in one.extras for text in EXTRAS[extra]]
        elif name not in found and (one.marker is None or one.marker.evaluate({"extra": ""})):
            found.add(name)
            waiting += map(Requirement, metadata.requires(name) or [])
    return found


def environment(folder, wheel, names):
    """A folder to import from that holds the wheel and distributions, as links, and no more."""
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    for name in names:
        one = metadata.distribution(name)
        for top in {Path(file).parts[0] for file in one.files} - {".."}:
            if top != "__pycache__" and not (folder / top).exists():
                (folder / top).symlink_to(one.locate_file(top))
    return folder


def run(folder, program, *arguments, python=sys.executable):
    """Run a program that imports from a folder and the standard library alone."""
    program = f"import sys\nsys.path[:] = [*sys.path, {str(folder)!r}]\n{program}"
    return subprocess.run(
        [python, "-I", "-S", "-c", program, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        env={key: value for key, value in os.environ.items() if not key.startswith("PYTHON")},
    )


def test_the_reader_needs_numpy_and_scipy_alone(wheel, files, tmp_path):
    folder = environment(tmp_path, wheel, ["numpy", "scipy"])
    assert distributions(PROJECT["dependencies"]) == {"numpy", "scipy"}
    done = run(folder, READ, files["samples"], files["body"])
    assert done.returncode == 0, done.stderr
    done = run(folder, "import drapeline.torch")
    assert "No module named 'torch'" in done.stderr


def test_data_sets_and_trained_models_need_the_extra_torch(wheel, files, tmp_path):
    names = distributions([*PROJECT["dependencies"], *EXTRAS["torch"]])
    assert not names & {"bpy", "snakemake", "pytorch-lightning", "anny", "pandas"}
    done = run(environment(tmp_path, wheel, names), TORCH, files["samples"], files["model"])
    assert done.returncode == 0, done.stderr


def test_the_wheel_names_the_versions_and_extras(wheel):
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (one for one in archive.namelist() if one.endswith(".dist-info/METADATA"))
        text = archive.read(name).decode()
        assert any(one.endswith(".html") for one in archive.namelist())
    assert set(re.findall(r"^Provides-Extra: (\w+)", text, re.M)) == {"torch", "pipeline", "dev"}
    assert set(re.search(r"^Requires-Python: (.*)", text, re.M)[1].split(",")) == {
        *(">=3.10", "<3.14"),
    }


@pytest.mark.parametrize("version", ["3.10", "3.11", "3.12", "3.13"])
def test_the_reader_runs_on_every_version_that_is_here(wheel, files, tmp_path, version):
    python = shutil.which(f"python{version}")
    about = "import numpy, scipy; print(numpy.__path__[0], scipy.__path__[0])"
    found = python and subprocess.run([python, "-c", about], capture_output=True, text=True)
    if not found or found.returncode:
        pytest.skip(f"no Python {version} with numpy and scipy")
    folder = environment(tmp_path, wheel, [])
    for package in map(Path, found.stdout.split()):
        for part in (package, package.with_name(f"{package.name}.libs")):
            if part.exists():
                (folder / part.name).symlink_to(part)
    done = run(folder, READ, files["samples"], files["body"], python=python)
    assert done.returncode == 0, done.stderr


def test_no_module_needs_a_later_python_than_the_first_one_named():
    assert PROJECT["requires-python"].startswith(">=3.10,")
    ruff = [sys.executable, "-m", "ruff", "check", "--isolated", "--target-version", "py310"]
    # Syntax of later versions is an error whatever is selected; regular expressions have their own.
    done = subprocess.run([*ruff, "--select", "E9", PACKAGE], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                possessive = re.search(r"[)\]}\w][*+?]\+\)", node.value)
                assert not possessive, f"{path}: {node.value!r} needs Python 3.11"
