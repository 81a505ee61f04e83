"""`drapeline check-config`: whether a workflow takes a config, and what it would make of it.

Nothing is run, and nothing that the config names is opened but tables and motions.
"""

import argparse
import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from drapeline.errors import InputError, refuse_damage
from drapeline.experiment.checks import refuse_contradictions
from drapeline.experiment.config import fill_settings
from drapeline.experiment.groups import plan_groups
from drapeline.experiment.old_keys import refuse_old_keys
from drapeline.experiment.settings import experiment_with
from drapeline.models.registry import models
from drapeline.motions.table import MotionTable
from drapeline.storage import read_text

_MOST_BYTES = 1_000_000
_TABLE = Path("workflow/resources/motions/clips.tsv")  # of the default experiment


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "files",
        nargs="+",
        metavar="CONFIG",
        help="YAML; of several, later ones decide, as with Snakemake's --configfile",
    )


def run(args: argparse.Namespace) -> int:
    """Check configs, and print how many samples of which groups they ask for.

    Returns:
        Exit status 0.
    """
    source = " + ".join(args.files)
    settings: dict[str, Any] = {}
    for file in args.files:
        settings = _merged(settings, _read(file))
    refuse_old_keys(settings, source)
    schema = experiment_with({n: model.settings for n, model in models().items()})
    filled = fill_settings(settings, schema.schema_of_config(), source)
    refuse_contradictions(filled)
    print(f"{source}: {_count(settings)} settings, each in range")
    table = filled["motions"]["table"] or _TABLE
    if not Path(table).is_file():
        print(f"{table} is not here, so samples were not planned")
        return 0
    motions = MotionTable(table, filled["motions"]["folder"])
    if motions.left_out:
        print(f"{table}: goes without {', '.join(motions.left_out)}, whose files are not here")
    for name, group in plan_groups(filled, motions).items():
        splits = [plan.split for plan in group.plans]
        parts = ", ".join(f"{splits.count(split)} {split}" for split in dict.fromkeys(splits))
        print(f"{name}: {len(group.plans)} samples ({parts})")
    return 0


def _read(file: str) -> dict[str, Any]:
    text = read_text(file, "YAML", most_bytes=_MOST_BYTES)
    with refuse_damage(file, "YAML"):
        found = yaml.safe_load(text)
    if found is None:
        return {}
    if isinstance(found, dict) and "__use_yte__" in found:
        raise InputError(
            f"{file}: has __use_yte__, with which Snakemake runs Python that the file holds,"
            " expected settings alone"
        )
    if not isinstance(found, dict):
        raise InputError(f"{file}: is {type(found).__name__}, expected settings, key: value")
    return found


def _merged(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    """Both, the second where they differ; mappings are merged key by key."""
    out = copy.deepcopy(dict(first))
    for key, value in second.items():
        if isinstance(value, Mapping) and isinstance(out.get(key), Mapping):
            out[key] = _merged(out[key], value)
        else:
            out[key] = value
    return out


def _count(settings: Mapping[str, Any]) -> int:
    return sum(_count(v) if isinstance(v, Mapping) and v else 1 for v in settings.values())
