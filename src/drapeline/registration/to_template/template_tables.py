"""Registration of many garments to the templates of their types, and its files."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from drapeline.errors import InputError
from drapeline.registration.to_body.registrar import error_rows, write_errors
from drapeline.registration.to_body.round_trip import Measure
from drapeline.registration.to_template.garment_template import GarmentTemplate
from drapeline.registration.to_template.remesh import RemeshTable, Residual, remesh_table, residual
from drapeline.registration.to_template.template_fit import FitSettings, FitTarget, fit_to_template
from drapeline.rule_log import progress
from drapeline.storage import atomic_folder, load_npz, save_npz

ERRORS = "metrics.tsv"
_UNITS = {"mm": "mm", "faces": "count"}


class NamedGarment(NamedTuple):
    """A garment in the rest pose.

    Attributes:
        name: of its outfit or sample.
        garment: its type.
        vertices, faces: (V, 3) metres, root frame, and (F, 3) or (F, 4).
    """

    name: str
    garment: str
    vertices: np.ndarray
    faces: np.ndarray


def write_tables(
    folder: str | Path,
    garments: Iterable[NamedGarment],
    templates: Mapping[str, GarmentTemplate],
    settings: FitSettings,
) -> int:
    """Register garments and write `{type}.npz` of remesh tables, and `metrics.tsv` of residuals.

    Args:
        folder: replaced as a whole.
        garments: those of types without a template are passed over.
        templates: by type.
        settings: of the registration.

    Returns:
        Number of garments registered.

    Raises:
        InputError: names the outfit whose garment cannot be registered.
    """
    wanted = [one for one in garments if one.garment in templates]
    targets = {garment: FitTarget(template) for garment, template in templates.items()}
    tables: dict[str, dict[str, np.ndarray]] = {garment: {} for garment in templates}
    errors: list[dict[str, Any]] = []
    for one in progress(wanted, total=len(wanted), label="garments"):
        target = targets[one.garment]
        try:
            table = remesh_table(fit_to_template(one.vertices, one.faces, target, settings), target)
        except InputError as error:
            raise InputError(f"{one.name}/{one.garment}: {error}") from error
        for key in RemeshTable._fields:
            tables[one.garment][f"{one.name}/{key}"] = getattr(table, key)
        found = residual(one.vertices, one.faces, target.template, table)
        errors += error_rows(one.garment, one.name, _measures(found))
    with atomic_folder(folder) as scratch:
        for garment, arrays in tables.items():
            save_npz(scratch / f"{garment}.npz", **arrays)
        write_errors(scratch / ERRORS, errors)
    return len(wanted)


def _measures(found: Residual) -> list[Measure]:
    return [
        Measure(name, float(value), _UNITS[name.rpartition("_")[2]])
        for name, value in found._asdict().items()
    ]


def load_tables(folders: Iterable[str | Path], garment: str) -> dict[str, RemeshTable]:
    """Remesh tables of the garments of one type, by the name of their outfit or sample.

    Args:
        folders: as `write_tables` leaves them.
        garment: the type.

    Raises:
        InputError: a file is missing or a garment lacks one of the two arrays.
    """
    found = {}
    for folder in folders:
        path = Path(folder) / f"{garment}.npz"
        arrays = load_npz(path)
        for name in dict.fromkeys(key.rpartition("/")[0] for key in arrays):
            for key in RemeshTable._fields:
                if f"{name}/{key}" not in arrays:
                    raise InputError(f"{path}: lacks {name}/{key}, expected it for every garment")
            found[name] = RemeshTable(*(arrays[f"{name}/{key}"] for key in RemeshTable._fields))
    return found
