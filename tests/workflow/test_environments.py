"""envs/*.yaml name the versions of requirements.lock, and all that their rules import."""

import re
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest
import yaml

from drapeline.experiment.cloth_solvers import CLOTH_SOLVERS
from drapeline.experiment.source_digest import Sources
from drapeline.models.registry import models
from toys.imported_modules import imported_modules
from toys.plans import files_of, tasks_of

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "drapeline"
SOURCES = Sources(ROOT / "src")
PINS = dict(
    line.lower().split("==")
    for line in (ROOT / "requirements.lock").read_text().splitlines()
    if "==" in line
)


@pytest.mark.parametrize("path", sorted((ROOT / "envs").glob("*.yaml")), ids=lambda p: p.stem)
def test_conda_environments_pin_what_the_lock_pins(path):
    dependencies = yaml.safe_load(path.read_text())["dependencies"]
    pip = next(d["pip"] for d in dependencies if isinstance(d, dict))
    assert "python=3.11" in dependencies
    for pin in pip:
        name, version = pin.lower().split("==")
        assert PINS[name] == version, f"{path.name} pins {pin}, the lock {PINS[name]}"


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
BASE, EXTRAS = PROJECT["dependencies"], PROJECT["optional-dependencies"]


def required(texts):
    """Names of the distributions in requirements of pyproject.toml."""
    names = {re.match(r"[\w.-]+", text)[0].lower() for text in texts}
    return names - {"drapeline"}


def test_the_lock_pins_every_dependency_of_the_package():
    for name in required([*BASE, *EXTRAS["dress"], *EXTRAS["torch"], *EXTRAS["pipeline"]]):
        assert name in PINS, f"{name} is not in requirements.lock"


DISTRIBUTIONS = {
    "PIL": "pillow",
    "igl": "libigl",
    "mathutils": "bpy",
    "pxr": "bpy",
    "pytorch_lightning": "pytorch-lightning",
    "skimage": "scikit-image",
    "sklearn": "scikit-learn",
    "warp": "warp-lang",
    "yaml": "pyyaml",
}


# Their environment is that of the solver, which the config names.
SIMULATIONS = ("simulate_outfits", "write_samples")


def script_environments():
    """Script and environment of every rule, and a module that the script is told of."""
    for solver in CLOTH_SOLVERS.values():
        for script in SIMULATIONS:
            yield script, solver.environment, solver.code
    for file in sorted((ROOT / "workflow/rules").glob("*.smk")):
        for rule in re.split(r"^(?:checkpoint|rule) ", file.read_text(), flags=re.MULTILINE)[1:]:
            script = re.search(r'"../../scripts/(\w+)\.py"', rule)
            environment = re.search(r'"../../envs/(\w+)\.yaml"', rule)
            if script and script.group(1) not in (*SIMULATIONS, "run_job"):
                yield script.group(1), environment and environment.group(1), None
    for model in models().values():
        for task in tasks_of(model.plan(files_of())).values():
            yield "run_job", task.environment, task.run


@cache
def third_party(path):
    """Distributions that a file imports, but for what only type checkers see."""
    tops = {name.split(".")[0] for name in imported_modules(path.read_text())}
    others = tops - sys.stdlib_module_names - {"drapeline", "snakemake"}
    return {DISTRIBUTIONS.get(top, top) for top in others}


@pytest.mark.parametrize(
    ("script", "environment", "module"), sorted(set(script_environments()), key=str)
)
def test_a_rules_environment_holds_what_its_script_imports(script, environment, module):
    file = ROOT / f"scripts/{script}.py"
    dependencies = yaml.safe_load((ROOT / f"envs/{environment}.yaml").read_text())["dependencies"]
    pins = {pin.lower().split("==")[0] for pin in dependencies[-1]["pip"]}
    imported = SOURCES.imported_files(file, *([module] if module else []))
    files = [file, *(f for f in imported if f.suffix == ".py")]
    needed = set().union(*map(third_party, files))
    assert needed <= pins, f"envs/{environment}.yaml lacks {', '.join(sorted(needed - pins))}"


# Modules that load trained models.
LOADERS = {
    SOURCES.file(loader.partition(":")[0])
    for model in models().values()
    for loader in model.loaders.values()
}


@pytest.mark.parametrize(
    ("extra", "entries"),
    [
        ("torch", [SOURCE / "torch.py", SOURCE / "models/load.py", *LOADERS]),
        ("pipeline", sorted(ROOT.glob("scripts/*.py"))),
    ],
)
def test_an_extra_names_all_that_its_modules_import(extra, entries):
    imported = set(entries).union(*map(SOURCES.imported_files, entries))
    needed = set().union(*(third_party(path) for path in imported if path.suffix == ".py"))
    named = required([*BASE, *EXTRAS["dress"], *EXTRAS["torch"], *EXTRAS[extra]])
    assert needed <= named, f"[{extra}] lacks {', '.join(sorted(needed - named))}"
