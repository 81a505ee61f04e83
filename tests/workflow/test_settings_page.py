"""Schema and settings.md are what docs/make_settings.py makes of the classes now."""

import importlib.util
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[2]


def generator():
    spec = importlib.util.spec_from_file_location("make_settings", ROOT / "docs/make_settings.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def leaves(schema, prefix=""):
    for name, part in schema["properties"].items():
        if "properties" in part and "overrides" not in part:
            yield from leaves(part, f"{prefix}{name}.")
        else:
            yield prefix + name


def test_the_schema_is_in_step_with_the_classes():
    make = generator()
    assert make.SCHEMA.read_text() == make.schema_text(), "run `make docs`"


def test_the_page_is_in_step_with_the_schema():
    make = generator()
    schema, paper = (yaml.safe_load(path.read_text()) for path in (make.SCHEMA, make.PAPER))
    page = make.settings_page(schema, paper)
    assert make.PAGE.read_text() == page, "run `make docs`"
    rows = [line for line in page.splitlines() if line.startswith("| `")]
    assert len(rows) == len(list(leaves(schema)))


def test_defaults_and_the_papers_values_are_shown():
    schema = {
        "properties": {
            "net": {
                "title": "Network",
                "default": {},
                "properties": {
                    "training": {
                        "default": {},
                        "properties": {"epochs": {"type": "integer", "default": 3}},
                    }
                },
            }
        }
    }
    page = generator().settings_page(schema, {"net": {"training": {"epochs": 50}}})
    assert "## Network: `net`" in page
    assert "### `net.training`" in page
    assert "| `epochs` | `3` | `50` | an integer |  |" in page
