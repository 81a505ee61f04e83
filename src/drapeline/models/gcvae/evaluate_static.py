"""Metrics of garments at rest, reconstructed by a trained VAE."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from drapeline.metrics.static import (
    StaticRows,
    Truth,
    add_kl,
    measure_predictions,
    static_summary,
)
from drapeline.metrics.table import MetricRow
from drapeline.models.gcvae.body_template import BodyTemplate
from drapeline.models.gcvae.codec import GarmentCodec, Garments
from drapeline.models.gcvae.codes import Codes, decode_codes
from drapeline.registration.to_body.topology import TOPOLOGIES


class StaticGarments(Garments, StaticRows, Protocol):
    """Registered garments in rest pose: what encoding reads and what evaluation reads."""


def static_truth(template: BodyTemplate, garments: StaticGarments) -> Truth:
    """The dataset as evaluation takes it, with the bodies and faces of a model's template."""
    return Truth(
        garments.offsets,
        garments.mask,
        body=lambda row: template.rest_body(garments.cvar(np.array([row]))[0]),
        faces=lambda row: template.faces[TOPOLOGIES[int(garments.topology(np.array([row]))[0])]],
        body_faces=template.faces[TOPOLOGIES[0]],
    )


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
) -> list[MetricRow]:
    """Rows of the table of metrics for a static model.

    Args:
        codes: (N, Z) of all rows of the dataset.
        variant: name of the model in the table.
        splits: to measure on.
    """
    seed = model.seed
    found = []
    for split in splits:
        rows = garments.rows(split)
        measures = measure_static(model, garments, rows, codes.of(rows))
        found += static_summary(
            garments, rows, measures, model=model.model, variant=variant, split=split, seed=seed
        )
    return found
