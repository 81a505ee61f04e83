"""What programs import: which names there are, where they are described, and what they cost."""

import ast
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import drapeline

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/reference/api.md").read_text()
# Removing one breaks programs of others.
PUBLIC = {
    *("open_dataset", "load", "import_motion", "simulate", "measure"),
    *("draw", "fit_image", "fit_points", "floor_report", "repose", "posed_vertices"),
    *("load_body", "load_obj", "save_motion", "save_obj", "save_outfit"),
    *("BodyModel", "Cloth3D", "InputError", "JOINT_NAMES", "Mesh", "Motion", "SimulatedSheet"),
    *("ReconstructionModel", "Sample", "SimulatedOutfit", "SmplicitModel", "StaticModel"),
}
OF_READER = ("BodyModel", "Cloth3D", "Mesh", "Motion", "load_body", "open_dataset", "save_obj")
BEYOND_READER = ("torch", "warp", "igl", "pydantic", "yaml", "trimesh", "threadpoolctl", "pandas")


def run(code):
    """Output of code in a Python of its own, and what went wrong."""
    python = [sys.executable, "-c", code]
    done = subprocess.run(python, env={"PYTHONPATH": str(ROOT / "src")}, capture_output=True)
    return done.stdout.decode(), done.stderr.decode()


def test_these_names_are_public():
    assert set(drapeline.__all__) == PUBLIC
    assert set(dir(drapeline)) >= PUBLIC


@pytest.mark.parametrize("name", sorted(PUBLIC))
def test_every_name_is_there_and_described(name):
    found = getattr(drapeline, name)
    assert re.search(rf"`(drapeline\.)?{name}`", PAGE), f"docs/reference/api.md lacks {name}"
    if inspect.isclass(found) or inspect.isfunction(found):
        assert found.__doc__
        assert found.__module__.startswith("drapeline.")


def test_type_checkers_see_the_same_names():
    stub = ast.parse((ROOT / "src/drapeline/__init__.pyi").read_text())
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    seen = {alias.asname: (node.module, alias.name) for node in imports for alias in node.names}
    assert set(seen) == PUBLIC
    for name, (module, attribute) in seen.items():
        assert getattr(sys.modules[module], attribute) is getattr(drapeline, name)


def test_a_name_that_does_not_exist_is_refused():
    with pytest.raises(AttributeError, match="no attribute 'lode'"):
        drapeline.lode  # noqa: B018


def test_importing_it_imports_nothing_else():
    out, _ = run("import sys, drapeline; print('numpy' in sys.modules, 'torch' in sys.modules)")
    assert out.split() == ["False", "False"]


def test_what_is_not_installed_is_said_in_a_sentence_that_names_the_extra():
    block = "import sys; sys.modules['torch'] = None\n"
    for code in ("import drapeline; drapeline.load", "from drapeline import load"):
        _, error = run(block + code)
        assert error.strip().splitlines()[-1] == (
            "ModuleNotFoundError: drapeline.load needs torch, which is not installed; expected"
            " drapeline with the extra [torch]: pip install 'drapeline[torch]'"
        )


def test_datasets_bodies_and_meshes_need_numpy_and_scipy_alone():
    code = "import sys\n"
    code += f"sys.modules.update(dict.fromkeys({BEYOND_READER}))\n"
    code += f"from drapeline import {', '.join(OF_READER)}\nprint('fine')"
    assert run(code) == ("fine\n", "")
