"""Metrics of garments at rest and in motion, encoded and decoded."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.learning_data.moving import MovingGarment
from drapeline.metrics.metric import Measured
from drapeline.metrics.registered import (
    add_kl,
    measure_motion,
    measure_predictions,
    measured_at_rest,
    measured_in_motion,
)
from drapeline.metrics.table import join, summarise
from drapeline.models.gcvae.codec import Codes, GarmentCodec, decode_codes, encode_garments
from drapeline.models.gcvae.data import DynamicGarments, StaticGarments
from drapeline.models.gcvae.decode import decode_points, resolve_points, static_truth
from drapeline.registration.to_body.topology import Topology
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


def evaluate_static(
    model: GarmentCodec, garments: StaticGarments, codes: Codes, variant: str, splits: Sequence[str]
) -> Table:
    """Rows of the table of metrics for a static model.

    Args:
        codes: (N, Z) of all rows of the dataset.
        variant: name of the model in the table.
        splits: to measure on.
    """
    tables = []
    for split in splits:
        rows = garments.rows(split)
        measures = measure_static(model, garments, rows, codes.of(rows))
        measured = measured_at_rest(garments, rows, measures)
        tables.append(_summarise(model, measured, variant, split, by_source=False))
    return join(tables)


def evaluate_dynamic(
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
        topology: of the super-resolved bodies.
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
                measures = measured_in_motion(moving, add_kl(measures, codes.kl_nat()))
                measured.setdefault(name, []).extend(measures)
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
