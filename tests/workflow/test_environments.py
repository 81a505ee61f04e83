"""envs/*.yaml name the versions of requirements.lock."""

import re
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
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


def test_the_lock_pins_every_dependency_of_the_package():
    text = (ROOT / "pyproject.toml").read_text()
    block = text.split("dependencies = [", 1)[1].split("\n]", 1)[0]
    for name in re.findall(r'"([A-Za-z0-9_.-]+)[><=]', block):
        assert name.lower() in PINS, f"{name} is not in requirements.lock"
