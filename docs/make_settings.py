"""Write the config's schema, and docs/reference/settings.md, the list of all its keys.

Both come from the classes of settings that `drapeline.experiment.settings` puts together.

PYTHONPATH=src .venv/bin/python docs/make_settings.py
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from drapeline.experiment.config import fill_settings
from drapeline.experiment.settings import experiment_with
from drapeline.models.registry import models
from drapeline.settings import allowed_values

ROOT = Path(__file__).parents[1]
SCHEMA = ROOT / "workflow/schemas/config.schema.yaml"
PAPER = ROOT / "workflow/config/paper.yaml"
PAGE = ROOT / "docs/reference/settings.md"

INTRODUCTION = """\
# Settings

All {count} keys that a config may name, by stage. `make docs` writes this page, and
[the schema](../../workflow/schemas/config.schema.yaml) that configs are checked against, from the
classes that `drapeline.experiment.settings` puts together.

A key that a config omits takes the default given here. Defaults suit a computer with two cores;
*paper* is the value in `workflow/config/paper.yaml`, the size of CLOTH3D, where it is another.
Units are part of the names, and frames are at 30 per second. A misspelt key or a value out of
range stops the run before the first job. Paths are relative to the folder in which Snakemake works.
[Make your own experiment](../how-to/own-experiment.md) says how to use a config.
"""


def schema_text() -> str:
    """The schema as YAML."""
    blocks = {name: model.settings for name, model in models().items()}
    draft = "https://json-schema.org/draft/2020-12/schema"
    schema = {
        "$schema": draft,
        **experiment_with(blocks).schema_of_config(),
        "title": "drapeline's experiment",
    }
    text = yaml.dump(
        schema,
        Dumper=_Dumper,
        sort_keys=False,
        width=100,
        allow_unicode=True,
    )
    return f"# Written by `make docs` from the classes of settings in src/.\n{text}"


class _Dumper(yaml.SafeDumper):
    """Without anchors, and with lists in one line."""

    def ignore_aliases(self, data: Any) -> bool:
        return True

    def represent_sequence(self, tag: str, sequence: Any, flow_style: bool | None = None) -> Any:
        return super().represent_sequence(tag, sequence, flow_style=True)


def settings_page(schema: Mapping[str, Any], paper: Mapping[str, Any]) -> str:
    """The page as Markdown.

    Args:
        schema: of the config.
        paper: the config at the size of the papers.
    """
    default, printed = (fill_settings(given, schema, "config") for given in ({}, paper))
    blocks, count = [], 0

    def add_table(title: str, leaves: Mapping[str, Mapping[str, Any]], path: str = "") -> None:
        nonlocal count
        blocks.append(title)
        if path and (about := _at(schema, path, "properties").get("description")):
            blocks.append(about)
        if leaves:
            values = (_at(default, path), _at(printed, path))
            blocks.append("\n".join(_table(leaves, *values)))
            count += len(leaves)

    parts = schema["properties"]
    add_table("## General", {name: part for name, part in parts.items() if not _is_group(part)})
    for stage, part in parts.items():
        if _is_group(part):
            own = {k: one for k, one in part["properties"].items() if not _is_group(one)}
            add_table(f"## {part.get('title', stage.capitalize())}: `{stage}`", own, stage)
            for name, group in part["properties"].items():
                if _is_group(group):
                    path = f"{stage}.{name}"
                    add_table(f"### `{path}`", dict(_leaves(group)), path)
    return "\n\n".join([INTRODUCTION.format(count=count).rstrip(), *blocks]) + "\n"


def _is_group(part: Mapping[str, Any]) -> bool:
    return "properties" in part and "overrides" not in part


def _leaves(group: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Dotted name within the group and schema of every key."""
    for name, part in group["properties"].items():
        if _is_group(part):
            yield from _leaves(part, f"{prefix}{name}.")
        else:
            yield prefix + name, part


def _at(tree: Mapping[str, Any], path: str, between: str = "") -> Any:
    """What stands at a dotted path; the empty path is the tree itself."""
    for name in filter(None, path.split(".")):
        tree = (tree[between] if between else tree).get(name, {})
    return tree


def _table(leaves: Mapping[str, Any], default: Any, paper: Any) -> list[str]:
    lines = ["| key | default | paper | takes | meaning |", "|---|---|---|---|---|"]
    for name, part in leaves.items():
        first, second = (_value(_at(values, name)) for values in (default, paper))
        cells = [
            f"`{name}`",
            first,
            second if second != first else "",
            allowed_values(part),
            part.get("description", "").strip(),
        ]
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return lines


def _value(value: Any) -> str:
    """As in YAML; a key without a default has none."""
    if value == {}:
        return ""
    return f"`{value if isinstance(value, str) else json.dumps(value)}`"


if __name__ == "__main__":
    SCHEMA.write_text(schema_text())
    schema, paper = (yaml.safe_load(path.read_text()) for path in (SCHEMA, PAPER))
    PAGE.write_text(settings_page(schema, paper))
