"""Sampled garments beside real ones: their folds, hems and crossings, and how varied they are."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from drapeline.bodies.model import BodyModel, load_bodies
from drapeline.generation.moving_sheets import SolverDraper, job_draper
from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.job import Job
from drapeline.learning_data.static import StaticData
from drapeline.learning_data.training_rows import rows_like
from drapeline.metrics.garment import garment_mesh
from drapeline.metrics.likeness import Variety, cloth_measures, variety
from drapeline.models.gcvae.data import BodyTemplate
from drapeline.models.gcvae.load import load_codec
from drapeline.models.gcvae.movers import hang_at_rest
from drapeline.models.gcvae.sample import (
    SavedSample,
    decode_by_type,
    load_samples,
    load_types,
)
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import GARMENTS
from drapeline.outfits.static import load_static
from drapeline.report.html import number
from drapeline.report.tables import Section, write_sections
from drapeline.rule_log import progress
from drapeline.seeding import rng_for
from drapeline.storage import write_rows

_HELD_OUT_MAX = 12  # garments of a type that each sampled one is compared with
_DIGITS = {"self_crossings": 1, "covered_share": 2, "nearest_mm": 1, "precise_mm": 1}
_TITLES = {
    "garments": "Garments",
    "self_crossings": "Edges through the garment itself",
    "folds_1cm_mm": "Folds at 1 cm, mm",
    "folds_2cm_mm": "at 2 cm",
    "folds_4cm_mm": "at 4 cm",
    "folds_8cm_mm": "at 8 cm",
    "hem_mm": "Jaggedness of hems, mm",
    "covered_share": "Held-out garments covered",
    "nearest_mm": "From these to the nearest, mm",
    "precise_mm": "From the nearest of these, mm",
}


def compare_with_real(job: Job) -> None:
    """Sampled garments beside at most as many real ones of each type, as a table and a page."""
    given, params = job.input, job.params
    samples, data = load_samples(given.samples), StaticData(given.data)
    varied = _varieties(samples, data, given.model, params.split, params.seed)
    template = load_codec(Path(given.model) / BEST).body_template
    held_out = data.rows(params.split)
    drawn = [GARMENTS.index(sample.garment) for sample in samples]
    chosen = held_out[rows_like(data.garment[held_out], drawn)]
    registered = [
        _worn(template, data, row, template.rest_body(data.cvar(np.array([row]))[0]))
        for row in chosen
    ]
    draper = job_draper(job, params.hang_frames)
    real = _hung_outfits(data, chosen, given.outfits, load_bodies(given), draper)
    rows = [
        _row("sampled, as decoded and mended", [sample.mesh for sample in samples]),
        _row("sampled, hung", [sample.hung for sample in samples], varied["sampled"]),
        _row("real, as registered", registered),
        _row("real, hung", real, varied["real"]),
    ]
    write_rows(job.output.table, rows)
    write_sections(
        job.output.page,
        "Sampled garments beside real ones",
        [
            "Garments of drawn codes, and held-out garments of the same experiment. Folds are how"
            " high cloth stands out at a scale, root mean square; a held-out garment is covered if"
            " a sampled one is as near to it as nine tenths of held-out garments have a real one"
            " of another set, of as many; in the row of real garments, those of a third set stand"
            " in place of the sampled ones. All are on one body then."
        ],
        [Section("Means over garments", [_shown(row) for row in rows])],
    )


def _row(name: str, meshes: Sequence[Mesh], varied: Variety | None = None) -> dict[str, str]:
    cloth = [mesh for mesh in meshes if len(mesh.faces)]
    measures = [cloth_measures(mesh) for mesh in progress(cloth, total=len(cloth), label=name)]
    values = {
        key: float(np.mean([one[key] for one in measures]))
        for key in (measures[0] if measures else ())
    }
    values |= {} if varied is None else varied._asdict()
    row = {"set": name, "garments": str(len(cloth))}
    row |= {key: f"{value:.{_DIGITS.get(key, 2)}f}" for key, value in values.items()}
    return {**dict.fromkeys(["set", *_TITLES], ""), **row}


def _shown(row: Mapping[str, str]) -> dict[str, object]:
    return {"": row["set"], **{title: number(row[key]) for key, title in _TITLES.items()}}


def _worn(template: BodyTemplate, data: StaticData, row: int, body: np.ndarray) -> Mesh:
    """A registered garment on a body (V, 3)."""
    faces = template.faces_of(GARMENTS[data.garment[row]])
    return garment_mesh(body + data.offsets[row], faces, np.asarray(data.mask[row]))


def _varieties(
    samples: Sequence[SavedSample], data: StaticData, folder: str, split: str, seed: int
) -> dict[str, Variety]:
    """Of sampled garments, and of as many real ones in their place."""
    model, types = load_codec(Path(folder) / BEST), load_types(folder)
    template, body = model.body_template, model.body_template.body_mean
    decoded = decode_by_type(
        model,
        types,
        np.stack([sample.z for sample in samples]),
        np.stack([sample.cvar for sample in samples]),
        [sample.garment for sample in samples],
    )
    sets: dict[str, dict[str, list[Mesh]]] = {
        name: {} for name in ("sampled", "held_out", "near", "real")
    }
    for garment, offsets, mask in decoded:
        mesh = garment_mesh(body + offsets, template.faces_of(garment), mask)
        if len(mesh.faces):
            sets["sampled"].setdefault(garment, []).append(mesh)
    rng = rng_for(seed, "real sets")
    for garment, made in sets["sampled"].items():
        of_type = data.garment == GARMENTS.index(garment)
        others = rng.permutation(data.rows("train")[of_type[data.rows("train")]])
        held = np.flatnonzero(of_type & (data.split == split))[:_HELD_OUT_MAX]
        parts = {
            "held_out": held,
            "near": others[: len(made)],
            "real": others[len(made) : 2 * len(made)],
        }
        for name, rows in parts.items():
            if len(rows):
                sets[name][garment] = [_worn(template, data, row, body) for row in rows]
    held_out, near = sets["held_out"], sets["near"]
    return {name: variety(sets[name], held_out, near) for name in ("sampled", "real")}


def _hung_outfits(
    data: StaticData,
    rows: np.ndarray,
    shards: Sequence[str],
    bodies: Mapping[str, BodyModel],
    draper: SolverDraper | None,
) -> list[Mesh]:
    """Real garments as they were made, each hung on its wearer as sampled ones are."""
    wanted = {(str(data.outfit[row]), GARMENTS[data.garment[row]]) for row in rows}
    names = {outfit for outfit, _ in wanted}
    hung = []
    for shard in shards:
        for static in load_static(shard):
            if static.name not in names:
                continue
            outfit = static.outfit
            for garment in outfit.garments:
                if (static.name, garment.name) in wanted:
                    mesh = {garment.name: Mesh(garment.vertices, triangulate(garment.faces))}
                    worn = hang_at_rest(
                        mesh, bodies[outfit.gender], outfit.gender, outfit.shape, draper
                    )
                    hung.append(worn[garment.name].posed)
    return hung
