"""What `pip install .` gives, without and with its extras, in an environment that holds no more.

Without the network: what pip would install is linked. `make test-install` does it with pip.
"""

import ast
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from install.first_use import READ, ROOT, TORCH, copy_library, write_files

PACKAGE = ROOT / "src" / "drapeline"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Built from a copy, without asking the network."""
    folder = copy_library(tmp_path_factory.mktemp("wheel"))
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-index", "--no-deps"]
    subprocess.run([*pip, "--no-build-isolation", "-w", "out", "."], cwd=folder, check=True)
    (path,) = (folder / "out").glob("*.whl")
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return write_files(tmp_path_factory.mktemp("files"))


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


def run(folder, program, *arguments):
    """Run a program that imports from a folder and the standard library alone."""
    program = f"import sys\nsys.path[:] = [*sys.path, {str(folder)!r}]\n{program}"
    return subprocess.run(
        [sys.executable, "-I", "-S", "-c", program, *map(str, arguments)],
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
    extras = {"dress", "torch", "pipeline", "notebook", "dev"}
    assert set(re.findall(r"^Provides-Extra: (\w+)", text, re.M)) == extras
    assert re.search(r"^Requires-Python: (.*)", text, re.M)[1] == ">=3.10"


def test_no_module_needs_a_later_python_than_the_first_one_named():
    assert PROJECT["requires-python"] == ">=3.10"
    ruff = [sys.executable, "-m", "ruff", "check", "--isolated", "--target-version", "py310"]
    # Syntax of later versions is an error whatever is selected; regular expressions have their own.
    done = subprocess.run([*ruff, "--select", "E9", PACKAGE], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                possessive = re.search(r"[)\]}\w][*+?]\+\)", node.value)
                assert not possessive, f"{path}: {node.value!r} needs Python 3.11"
