"""Metrics of garments at rest and in motion, encoded and decoded."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import torch

from drapeline.bodies.model import BodyModel, load_bodies
from drapeline.bodies.rest_body import rest_body
from drapeline.job import Job
from drapeline.learning_data.moving import MovingGarment, load_moving
from drapeline.learning_data.static import StaticData
from drapeline.metrics.baselines import moving_baseline_summary, static_baseline_summary
from drapeline.metrics.metric import Measured
from drapeline.metrics.registered import (
    Truth,
    add_kl,
    measure_motion,
    measure_predictions,
    measured_at_rest,
    measured_in_motion,
)
from drapeline.metrics.table import join, summarise, write_evaluation
from drapeline.models.compare import compare, fit_scans
from drapeline.models.gcvae.codec import (
    CODES,
    Codes,
    GarmentCodec,
    decode_codes,
    encode_garments,
    encode_held_out,
    save_codes,
)
from drapeline.models.gcvae.data import DynamicGarments, StaticGarments
from drapeline.models.gcvae.decode import decode_points, resolve_points, static_truth
from drapeline.models.gcvae.load import load_codec, load_dynamic_garments, load_training_codes
from drapeline.models.gcvae.representation import (
    CodeScanFitter,
    FitCode,
    OffsetPca,
    RegisteredOffsets,
    VaeCode,
)
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.topology import Topology, load_topology
from drapeline.rule_log import progress
from drapeline.schema import Table

RESOLVED_SUFFIX = "_settled"  # of a variant whose garments were pushed out of the body


def measure_static(
    model: GarmentCodec, garments: StaticGarments, rows: np.ndarray, codes: Codes
) -> list[dict[str, float]]:
    """Every metric of each row's reconstruction from the mean of its code (n, Z)."""
    decoded = decode_codes(model, codes.mean, garments.cvar(rows), garments.topology(rows))
    measures = measure_predictions(
        static_truth(model.body_template, garments), zip(rows.tolist(), decoded, strict=True)
    )
    return add_kl(measures, codes.kl_nat())


def static_rows(
    model: GarmentCodec, garments: StaticGarments, codes: Codes, variant: str, splits: Sequence[str]
) -> Table:
    """Rows of the table of metrics for a static model and its codes (N, Z) of all rows."""
    tables = []
    for split in splits:
        rows = garments.rows(split)
        measures = measure_static(model, garments, rows, codes.of(rows))
        measured = measured_at_rest(garments, rows, measures)
        tables.append(_summarise(model, measured, variant, split, by_source=False))
    return join(tables)


def dynamic_rows(
    model: GarmentCodec,
    garments: DynamicGarments,
    held_out: Mapping[str, Iterable[MovingGarment]],
    bodies: Mapping[str, BodyModel],
    topology: Topology,
    variant: str,
) -> Table:
    """Rows of the table of metrics for a dynamic model.

    A model that resolves penetration has rows of its garments before and after that.

    Args:
        garments: every frame that is measured.
        held_out: split -> the same garments with their simulation and skinning weights.
        bodies: super-resolved, by gender.
        variant: name of the model in the table.
    """
    tables = []
    for split, movings in held_out.items():
        measured: dict[str, list[Measured]] = {}
        for moving in progress(movings, label=split):
            rows = garments.data.rows_of(moving.sample, moving.name)
            body = bodies[moving.gender]
            codes = encode_garments(model, garments, rows)
            points = decode_points(model, garments, rows, moving, body, codes.mean)
            frames = garments.data.frame[rows]
            decoded = {variant: points}
            if model.resolves_penetration:
                poses = moving.poses[frames]
                resolved = resolve_points(moving, body, topology, points, poses)
                decoded[variant + RESOLVED_SUFFIX] = resolved
            for name, cloth in decoded.items():
                measures = measure_motion(moving, frames, cloth, body, topology)
                measures = add_kl(measures, codes.kl_nat())
                measured.setdefault(name, []).extend(measured_in_motion(moving, measures))
        tables += [_summarise(model, frames, name, split) for name, frames in measured.items()]
    return join(tables)


def _summarise(
    model: GarmentCodec,
    measured: Sequence[Measured],
    variant: str,
    split: str,
    *,
    by_source: bool = True,
) -> Table:
    return summarise(
        measured,
        model=model.model,
        variant=variant,
        split=split,
        seed=model.seed,
        stream=(variant, split),
        by_source=by_source,
    )


def evaluate_baselines(job: Job) -> None:
    """What trivial predictions of static garments reach."""
    given, params = job.input, job.params
    data, topology, bodies = (
        StaticData(given.data),
        load_topology(given.topology),
        load_bodies(given),
    )
    truth = Truth(
        data.offsets,
        data.mask,
        body=lambda row: rest_body(bodies[data.gender[row]], data.shape[row]),
        faces=lambda row: topology.faces_of(GARMENTS[data.garment[row]]),
        body_faces=topology.faces,
    )
    rows = static_baseline_summary(
        truth, data, params.splits, components=params.components, seed=params.seed
    )
    write_evaluation(job.output[0], rows)


def evaluate_dynamic_baselines(job: Job) -> None:
    """What trivial predictions of garments in motion reach."""
    given, params = job.input, job.params
    files = given.samples, given.registrations
    rows = moving_baseline_summary(
        load_moving(*files, "train"),
        {split: load_moving(*files, split) for split in params.splits},
        load_bodies(given),
        load_topology(given.topology),
        step=params.step,
        seed=params.seed,
    )
    write_evaluation(job.output[0], rows)


def evaluate_static(job: Job) -> None:
    """Codes of all static garments, and metrics of their reconstructions."""
    given, params = job.input, job.params
    model, data = load_codec(Path(given.model) / BEST), StaticData(given.data)
    codes = encode_held_out(model, data, load_training_codes(given.model).codes)
    rows = static_rows(model, data, codes, params.variant, params.splits)
    write_evaluation(job.output[0], rows, lambda made: save_codes(made / CODES, codes, data))


def evaluate_dynamic(job: Job) -> None:
    """Metrics of the reconstructions of garments in motion."""
    given, params = job.input, job.params
    rows = dynamic_rows(
        load_codec(Path(given.model) / BEST),
        load_dynamic_garments(given.data, given.static, params.frames),
        {split: load_moving(given.samples, given.registrations, split) for split in params.splits},
        load_bodies(given),
        load_topology(given.topology),
        params.variant,
    )
    write_evaluation(job.output[0], rows)


def compare_codes(job: Job) -> None:
    """Held-out garments as offsets, PCA and codes of the garment VAEs."""
    given, params = job.input, job.params
    data = StaticData(given.data)
    codecs = {Path(folder).name: load_codec(Path(folder) / BEST) for folder in given.models}
    template = next(iter(codecs.values())).body_template
    compare(
        job,
        [
            RegisteredOffsets(data, template),
            OffsetPca(data, template, params.components),
            *(VaeCode(variant, model, data) for variant, model in codecs.items()),
        ],
    )


def fit_codes_to_scans(job: Job) -> None:
    """Codes of garment VAEs and masked PCA for held-out scans."""
    torch.set_num_threads(job.threads)
    bodies = load_bodies(job.input)
    codecs = {f"{Path(path).name}_scan": load_codec(Path(path) / BEST) for path in job.input.models}
    fit_scans(job, CodeScanFitter(codecs, bodies, FitCode()), bodies)
