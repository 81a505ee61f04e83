"""All models compared, on the same held-out garments and on the same segmented scans.

The scans are compared as in SMPLicit 4.2 and table 2.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.moved_body import BodyState
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import clip_name, solver_name
from drapeline.dataset.segmented_scans import SegmentedScan, load_scans
from drapeline.dataset.shards import samples_of
from drapeline.errors import DamagedFile
from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.job import Job
from drapeline.learning_data.static import StaticData
from drapeline.metrics.garment import area_distances_mm
from drapeline.metrics.metric import Measured
from drapeline.metrics.predictions import BODY, FITTED, TRUE, Fits, save_fitted_scans
from drapeline.metrics.properties import COMMON, measure_properties, scan_class
from drapeline.metrics.table import ALL, join, summarise, write_evaluation
from drapeline.models.contract import HeldOutGarment, Representation, ScanFitter
from drapeline.outfits.garment_types import GARMENT4D_TYPES, GARMENT_TYPES, GARMENTS
from drapeline.outfits.static import StaticOutfit, load_static
from drapeline.rule_log import progress
from drapeline.schema import Table

# Of the rows in the table of metrics.
REPRESENTATION, SCAN = "representation", "scan"


def held_out_garments(
    data: StaticData, outfits: Iterable[StaticOutfit], types: Sequence[str], split: str
) -> list[HeldOutGarment]:
    """The garments of some types in a split, in the order of the dataset's rows.

    Args:
        data: registered to the body.
        outfits: the same garments as they were made, among others.
        types: of `GARMENTS`.
        split: "val" or "test".
    """
    rows = data.rows(split)
    rows = rows[np.isin(data.garment[rows], [GARMENTS.index(name) for name in types])]
    names = [(str(data.outfit[row]), GARMENTS[data.garment[row]]) for row in rows]
    wanted = set(names)
    meshes = {
        (name, garment.name): Mesh(garment.vertices, triangulate(garment.faces))
        for name, _, outfit in outfits
        for garment in outfit.garments
        if (name, garment.name) in wanted
    }
    return [
        HeldOutGarment(int(row), *pair, meshes[pair]) for row, pair in zip(rows, names, strict=True)
    ]


def compare_representations(
    garments: Sequence[HeldOutGarment],
    representations: Iterable[Representation],
    *,
    split: str,
    seed: int,
) -> Table:
    """Distances between garments as they were made and as rebuilt, and the size of each code.

    A code cannot give back what registration has lost. What a decoder knows besides the code, such
    as the body's shape, does not count towards its size.

    Args:
        garments: of `split`.
        split: named in the rows.
    """
    tables = []
    for representation in representations:
        variant = representation.variant
        rows = []
        rebuilt = progress(representation.rebuild(garments), total=len(garments), label=variant)
        for garment, mesh in zip(garments, rebuilt, strict=True):
            to_true, to_rebuilt = area_distances_mm(mesh, garment.mesh)
            measured = {"surface_to_true_mm": to_true, "true_to_surface_mm": to_rebuilt}
            numbers = representation.code_numbers(garment.garment)
            if numbers is not None:
                measured["code_numbers"] = numbers
            rows.append(Measured(garment.outfit, garment.garment, measured))
        tables.append(
            summarise(
                rows, model=REPRESENTATION, variant=variant, split=split, seed=seed, by_source=False
            )
        )
    return join(tables)


class KnownScan(NamedTuple):
    """A scan of a simulated sample."""

    scan: SegmentedScan  # with what is known of it
    body: BodyState  # fitted to it
    clip: str  # that the sample moves through
    source: str  # cloth solver that moved the garments
    true: dict[str, Mesh]  # garment -> simulated triangles, in the scan's world
    classes: dict[str, str]  # garment -> one of `CLASSES`
    true_body: np.ndarray  # (V, 3) vertices of the simulated body


def known_scans(
    scans: Sequence[str | Path], samples: Sequence[str | Path], bodies: Mapping[str, BodyModel]
) -> list[KnownScan]:
    """Scans of samples, with the truth.

    Args:
        scans: files of scans with fitted bodies, as `save_scans` wrote them.
        samples: folders of all samples that they were taken of, named by their ids.
        bodies: by gender.

    Raises:
        InputError: a file is missing, lacks an array, or has a scan of another sample.
    """
    known, folders = [], {Path(folder).name: folder for folder in samples}
    for path in scans:
        for name, taken in groupby(load_scans(path), lambda pair: pair[0].name.rpartition("_")[0]):
            if name not in folders:
                raise DamagedFile(path, f"has a scan of '{name}', expected one of {len(folders)}")
            with Sample(folders[name]) as sample:
                known += _known(list(taken), sample, bodies[sample.gender])
    return known


def _known(
    taken: Sequence[tuple[SegmentedScan, BodyState]], sample: Sample, body: BodyModel
) -> list[KnownScan]:
    shape, rest, classes = sample.info.shape, {}, {}
    for name in sample.garments:
        mesh, region = sample.mesh(name), GARMENT_TYPES[name].region
        rest[name] = Mesh(mesh.vertices, triangulate(mesh.faces))
        properties = measure_properties(region, rest[name], body, shape)
        classes[name] = scan_class(region, properties)
    meta = sample.meta or {}
    known, clip, source = [], clip_name(meta, sample.id), solver_name(meta)
    for scan, fitted in taken:
        frame = scan.frame
        true = {
            name: Mesh(sample.vertices(name, frame, frame + 1, "root")[0], mesh.faces)
            for name, mesh in rest.items()
        }
        pose = sample.info.poses[frame].astype(np.float64)
        vertices, _ = posed_vertices(body, shape, pose[None])
        known.append(KnownScan(scan, fitted, clip, source, true, classes, vertices[0]))
    return known


def compare_scan_fits(
    scans: Sequence[KnownScan], fitter: ScanFitter, *, split: str, seed: int
) -> tuple[Table, dict[str, Fits]]:
    """Distances between simulated and fitted garments, by variant and class, over their area.

    Models do not know the same garments: the rows of the class `COMMON` are means over those that
    all of them know.

    Args:
        split: of the samples, named in the rows.

    Returns:
        Rows, and scan's name -> fits.
    """
    measured: dict[str, list[Measured]] = {}
    common: dict[str, list[Measured]] = {}
    shown: dict[str, Fits] = {}
    for known in progress(scans, total=len(scans), label="scans"):
        fits = shown[known.scan.name] = fitter.fit(known.scan, known.body)
        for variant, garments in fits.items():
            for name, mesh in garments.items():
                to_true, to_surface = area_distances_mm(mesh, known.true[name])
                row = {"surface_to_true_mm": to_true, "true_to_surface_mm": to_surface}
                fit = Measured(known.clip, known.classes[name], row, known.source)
                measured.setdefault(variant, []).append(fit)
                if name in GARMENT4D_TYPES:
                    common.setdefault(variant, []).append(fit._replace(garment=COMMON))
    summary = partial(summarise, model=SCAN, split=split, seed=seed)
    tables = []
    for variant, rows in measured.items():
        tables.append(summary(rows, variant=variant))
        of_common = summary(common.get(variant, []), variant=variant)
        tables.append(of_common[of_common["garment"] == COMMON])
    return join(tables), shown


def compare(job: Job, representations: Iterable[Representation]) -> None:
    """Leave the evaluation `representations` of a model.

    Args:
        job: its input has `data`, the static garments, and `outfits`, the same as they were made;
            its params `garments`, `split` and `seed`.
    """
    given, params = job.input, job.params
    outfits = (outfit for shard in given.outfits for outfit in load_static(shard))
    garments = held_out_garments(StaticData(given.data), outfits, params.garments, params.split)
    rows = compare_representations(garments, representations, split=params.split, seed=params.seed)
    write_evaluation(job.output[0], rows)


def fit_scans(job: Job, fitter: ScanFitter, bodies: Mapping[str, BodyModel]) -> None:
    """Leave the evaluation `scans` of a model.

    Args:
        job: its input has `scans`, and `samples` that they were taken of; its params `split` and
            `seed`.
        bodies: by gender.
    """
    scans = known_scans(job.input.scans, samples_of(job.input.samples), bodies)
    rows, found = compare_scan_fits(scans, fitter, split=job.params.split, seed=job.params.seed)
    write_evaluation(job.output[0], rows, lambda made: save_fitted_scans(made / FITTED, found))


def truth_shown(known: KnownScan, bodies: Mapping[str, BodyModel]) -> Fits:
    """Simulated garments and body of a scan, and the body that was fitted to it, for figures."""
    body = bodies[known.scan.gender]
    return {
        TRUE: {**known.true, BODY: Mesh(known.true_body, body.faces)},
        BODY: {BODY: skin_of(known.body, body)},
    }


def skin_of(state: BodyState, body: BodyModel) -> Mesh:
    """The triangles of a body in a state."""
    vertices, _ = posed_vertices(body, state.shape, state.pose[None], state.trans[None])
    return Mesh(vertices[0], body.faces)


def body_rows(
    scans: Sequence[KnownScan],
    states: Mapping[str, Sequence[BodyState]],
    bodies: Mapping[str, BodyModel],
    *,
    split: str,
    seed: int,
) -> Table:
    """Mean distances of bodies' vertices from the simulated ones.

    Args:
        scans: that bodies were fitted to.
        states: variant -> the body of each scan.
        bodies: by gender.
        split: of the samples, named in the rows.
    """
    rows = []
    for variant, every in states.items():
        measured = []
        for known, state in zip(scans, every, strict=True):
            error = body_error_mm(known, state, bodies[known.scan.gender])
            measured.append(Measured(known.clip, BODY, {"vertex_error_mm": error}, known.source))
        made = summarise(measured, model=SCAN, variant=variant, split=split, seed=seed)
        rows.append(made[made["garment"] == ALL])
    return join(rows)


def body_error_mm(known: KnownScan, state: BodyState, body: BodyModel) -> float:
    """Mean distance between the vertices of the simulated body and of one in a state."""
    vertices = skin_of(state, body).vertices
    return float(1000 * np.linalg.norm(vertices - known.true_body, axis=1).mean())
