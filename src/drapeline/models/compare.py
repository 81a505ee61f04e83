"""All models compared: held-out garments at rest, moved, and found in segmented scans.

The scans are compared as in SMPLicit 4.2 and table 2.
"""

import resource
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
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
from drapeline.dataset.settings import CLEAN, NOISY, WORSE
from drapeline.dataset.shards import samples_of
from drapeline.errors import DamagedFile
from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.job import Job
from drapeline.learning_data.static import StaticData
from drapeline.metrics.cost import Cost, write_costs
from drapeline.metrics.garment import mesh_measures
from drapeline.metrics.metric import Measured
from drapeline.metrics.predictions import BODY, FITTED, TRUE, Fits, save_fitted_scans
from drapeline.metrics.properties import COMMON, measure_properties, scan_class
from drapeline.metrics.shared import CLEAN_SCAN, MOVED, REPRESENTATION, SCAN, WORSE_SCAN
from drapeline.metrics.table import ALL, join, summarise, write_evaluation
from drapeline.models.contract import (
    HeldOutGarment,
    Mover,
    MovingPerson,
    Representation,
    ScanFitter,
    Stopwatch,
)
from drapeline.outfits.garment_types import (
    GARMENT_TYPES,
    GARMENTS,
    layered,
)
from drapeline.outfits.static import StaticOutfit, load_static
from drapeline.rule_log import progress
from drapeline.schema import Table

# Kind of scans -> the model of its rows in the table of metrics.
SCANNED = {NOISY: SCAN, CLEAN: CLEAN_SCAN, WORSE: WORSE_SCAN}


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
) -> tuple[Table, list[Cost]]:
    """Garments as rebuilt measured against those that were made, and the size of each code.

    A code cannot give back what registration has lost. What a decoder knows besides the code, such
    as the body's shape, does not count towards its size.

    Args:
        garments: of `split`.
        split: named in the rows.

    Returns:
        Rows, and what encoding and decoding took.
    """
    tables, costs = [], []
    for representation in representations:
        variant = representation.variant
        rows, watch = [], Stopwatch()
        rebuilt = _counted(representation.rebuild(garments), watch, variant)
        rebuilt = progress(rebuilt, total=len(garments), label=variant)
        for garment, mesh in zip(garments, rebuilt, strict=True):
            measured = mesh_measures(mesh, garment.mesh)
            numbers = representation.code_numbers(garment.garment)
            if numbers is not None:
                measured["code_numbers"] = numbers
            rows.append(Measured(garment.outfit, garment.garment, measured))
        costs.append(cost_so_far(REPRESENTATION, variant, watch.seconds[variant], len(rows)))
        tables.append(
            summarise(
                rows, model=REPRESENTATION, variant=variant, split=split, seed=seed, by_source=False
            )
        )
    return join(tables), costs


def _counted(meshes: Iterator[Mesh], watch: Stopwatch, variant: str) -> Iterator[Mesh]:
    """The same meshes, while what each takes is counted."""
    while True:
        with watch.of(variant):
            mesh = next(meshes, None)
        if mesh is None:
            return
        yield mesh


def cost_so_far(model: str, variant: str, seconds: float, garments: int) -> Cost:
    """Of a variant, given its seconds in all, and the most memory that this job has taken."""
    megabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return Cost(model, variant, seconds / max(garments, 1), garments, megabytes)


class KnownScan(NamedTuple):
    """A scan of a simulated sample."""

    scan: SegmentedScan  # with what is known of it
    person: MovingPerson  # who was scanned, up to this frame
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
                raise DamagedFile(
                    path, f"has a scan of '{name}', expected one of the {len(folders)} samples"
                )
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
        poses = sample.info.poses[: frame + 1].astype(np.float64)
        trans = np.asarray(sample.info.trans[: frame + 1], dtype=np.float64)
        vertices, _ = posed_vertices(body, shape, poses[-1:])
        worn = {name: rest[name] for name in layered(rest)}
        person = MovingPerson(
            sample.id, sample.gender, shape, poses, trans, worn, sample.info.tightness
        )
        known.append(KnownScan(scan, person, fitted, clip, source, true, classes, vertices[0]))
    return known


def compare_frames(
    scans: Sequence[KnownScan],
    answer: Callable[[KnownScan], Fits],
    watch: Stopwatch,
    *,
    model: str,
    garments: Collection[str],
    split: str,
    seed: int,
) -> tuple[Table, dict[str, Fits], list[Cost]]:
    """Measures of garments in frames of simulated samples, by variant and class.

    Models do not know the same garments: the rows of the class `COMMON` are means over those that
    all of them know.

    Args:
        answer: the garments in a frame, in each way.
        watch: counts what they take.
        model: named in the rows, as are `split`, of the samples, and `seed`.
        garments: types that all models know.

    Returns:
        Rows, scan's name -> fits, and what these took.
    """
    measured: dict[str, list[Measured]] = {}
    common: dict[str, list[Measured]] = {}
    shown: dict[str, Fits] = {}
    seconds: dict[str, float] = defaultdict(float)
    for known in progress(scans, total=len(scans), label="scans"):
        watch.reset()
        fits = shown[known.scan.name] = answer(known)
        for variant, worn in fits.items():
            seconds[variant] += watch.seconds[variant]
            for name, mesh in worn.items():
                row = mesh_measures(mesh, known.true[name])
                fit = Measured(known.clip, known.classes[name], row, known.source)
                measured.setdefault(variant, []).append(fit)
                if name in garments:
                    common.setdefault(variant, []).append(fit._replace(garment=COMMON))
    summary = partial(summarise, model=model, split=split, seed=seed)
    tables = []
    for variant, rows in measured.items():
        tables.append(summary(rows, variant=variant))
        of_common = summary(common.get(variant, []), variant=variant)
        tables.append(of_common[of_common["garment"] == COMMON])
    costs = [cost_so_far(model, name, seconds[name], len(rows)) for name, rows in measured.items()]
    return join(tables), shown, costs


def compare(
    job: Job, representations: Iterable[Representation], known: Sequence[Cost] | None = None
) -> None:
    """Leave the evaluation `representations` of a model.

    Args:
        job: its input has `data`, the static garments, and `outfits`, the same as they were made;
            its params `garments`, `split` and `seed`.
        known: what representations took whose codes come from an earlier job.
    """
    given, params = job.input, job.params
    outfits = (outfit for shard in given.outfits for outfit in load_static(shard))
    garments = held_out_garments(StaticData(given.data), outfits, params.garments, params.split)
    rows, costs = compare_representations(
        garments, representations, split=params.split, seed=params.seed
    )
    costs = costs if known is None else list(known)
    write_evaluation(job.output[0], rows, lambda made: write_costs(made, costs))


def fit_scans(job: Job, fitter: ScanFitter, bodies: Mapping[str, BodyModel]) -> None:
    """Leave an evaluation of a model on scans.

    Args:
        job: its input has `scans`, and `samples` that they were taken of; its params `kind` of the
            scans, `garments` that all models know, `split` and `seed`.
        bodies: by gender.
    """
    scans = known_scans(job.input.scans, samples_of(job.input.samples), bodies)
    model = SCANNED[job.params.kind]
    answer_frames(job, scans, lambda one: fitter.fit(one.scan, one.body), fitter.watch, model)


def move_garments(job: Job, mover: Mover, bodies: Mapping[str, BodyModel]) -> None:
    """Leave the evaluation `moved` of a model, of the true garments at rest.

    Args:
        job: its input has exact `scans`, whose frames are predicted, and `samples` that they were
            taken of; its params `garments` that all models know, `split` and `seed`.
        bodies: by gender.
    """
    scans = known_scans(job.input.scans, samples_of(job.input.samples), bodies)
    answer_frames(job, scans, lambda one: mover.move(one.person), mover.watch, MOVED)


def answer_frames(
    job: Job,
    scans: Sequence[KnownScan],
    answer: Callable[[KnownScan], Fits],
    watch: Stopwatch,
    model: str,
) -> None:
    """Leave an evaluation of garments in frames, see `compare_frames` for the arguments."""
    about = {key: getattr(job.params, key) for key in ("garments", "split", "seed")}
    write_frames(job.output[0], *compare_frames(scans, answer, watch, model=model, **about))


def write_frames(
    folder: str | Path, rows: Table, found: Mapping[str, Fits], costs: Sequence[Cost]
) -> None:
    """Leave what `compare_frames` gave."""

    def complete(made: Path) -> None:
        save_fitted_scans(made / FITTED, found)
        write_costs(made, costs)

    write_evaluation(folder, rows, complete)


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
    model: str,
    split: str,
    seed: int,
) -> Table:
    """Mean distances of bodies' vertices from the simulated ones.

    Args:
        scans: that bodies were fitted to.
        states: variant -> the body of each scan.
        bodies: by gender.
        model: named in the rows, as are `split`, of the samples, and `seed`.
    """
    rows = []
    for variant, every in states.items():
        measured = []
        for known, state in zip(scans, every, strict=True):
            error = body_error_mm(known, state, bodies[known.scan.gender])
            measured.append(Measured(known.clip, BODY, {"vertex_error_mm": error}, known.source))
        made = summarise(measured, model=model, variant=variant, split=split, seed=seed)
        rows.append(made[made["garment"] == ALL])
    return join(rows)


def body_error_mm(known: KnownScan, state: BodyState, body: BodyModel) -> float:
    """Mean distance between the vertices of the simulated body and of one in a state."""
    vertices = skin_of(state, body).vertices
    return float(1000 * np.linalg.norm(vertices - known.true_body, axis=1).mean())
