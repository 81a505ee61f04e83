"""Registration of many garments to the templates of their types, written to files."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from drapeline.dataset.reader import Sample
from drapeline.dataset.record import read_record
from drapeline.dataset.shards import samples_of
from drapeline.errors import InputError
from drapeline.outfits.static import load_static
from drapeline.registration.error_table import FILE_NAME, Measure, error_rows, write_errors
from drapeline.registration.settings import TemplateFitSettings
from drapeline.registration.to_template.garment_template import GarmentTemplate
from drapeline.registration.to_template.remesh import Residual, remesh_table, residual
from drapeline.registration.to_template.remesh_table import RemeshTable
from drapeline.registration.to_template.template_fit import FitTarget, fit_to_template
from drapeline.rule_log import progress
from drapeline.storage import atomic_folder, save_npz

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


def garments_at_rest(shard: str | Path, *, simulated: bool) -> list[NamedGarment]:
    """Garments of a shard in the rest pose.

    Args:
        shard: of simulated samples, of which only accepted ones count; or of outfits at rest.
        simulated: which of the two.

    Raises:
        InputError: a file is missing or damaged.
    """
    if simulated:
        return [garment for sample in samples_of([shard]) for garment in _of_sample(sample)]
    return [
        NamedGarment(name, garment.name, garment.vertices, garment.faces)
        for name, _, outfit in load_static(shard)
        for garment in outfit.garments
    ]


def _of_sample(folder: Path) -> list[NamedGarment]:
    if not read_record(folder).accepted:
        return []
    with Sample(folder) as sample:
        meshes = {name: sample.mesh(name) for name in sample.garments}
        return [
            NamedGarment(sample.id, name, mesh.vertices, mesh.faces)
            for name, mesh in meshes.items()
        ]


def write_tables(
    folder: str | Path,
    garments: Iterable[NamedGarment],
    templates: Mapping[str, GarmentTemplate],
    settings: TemplateFitSettings,
) -> int:
    """Register garments and write `{type}.npz` of remesh tables, and `metrics.tsv` of residuals.

    Args:
        folder: replaced as a whole.
        garments: those of types without a template are ignored.
        templates: by type.
        settings: of the registration.

    Returns:
        Number of garments registered.

    Raises:
        InputError: names the outfit whose garment cannot be registered.
    """
    wanted = [item for item in garments if item.garment in templates]
    targets = {garment: FitTarget(template) for garment, template in templates.items()}
    tables: dict[str, dict[str, np.ndarray]] = {garment: {} for garment in templates}
    errors: list[dict[str, Any]] = []
    for name, garment, vertices, faces in progress(wanted, total=len(wanted), label="garments"):
        target = targets[garment]
        try:
            table = remesh_table(fit_to_template(vertices, faces, target, settings), target)
        except InputError as error:
            raise InputError(f"{name}/{garment}: {error}") from error
        for key in RemeshTable._fields:
            tables[garment][f"{name}/{key}"] = getattr(table, key)
        left = residual(vertices, faces, target.template, table)
        errors += error_rows(garment, name, _measures(left))
    with atomic_folder(folder) as scratch:
        for garment, arrays in tables.items():
            save_npz(scratch / f"{garment}.npz", **arrays)
        write_errors(scratch / FILE_NAME, errors)
    return len(wanted)


def _measures(left: Residual) -> list[Measure]:
    return [
        Measure(name, float(value), _UNITS[name.rpartition("_")[2]])
        for name, value in left._asdict().items()
    ]
