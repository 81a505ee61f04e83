"""Metrics of garments at rest, reconstructed by a trained VAE."""

from collections.abc import Sequence

import numpy as np

from drapeline.metrics.registered import (
    add_kl,
    measure_predictions,
    measured_at_rest,
)
from drapeline.metrics.table import join, summarise
from drapeline.models.gcvae.codec import GarmentCodec
from drapeline.models.gcvae.codes import Codes, decode_codes
from drapeline.models.gcvae.truth import StaticGarments, static_truth
from drapeline.schema import Table


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
    found = []
    for split in splits:
        rows = garments.rows(split)
        measures = measure_static(model, garments, rows, codes.of(rows))
        measured = measured_at_rest(garments, rows, measures)
        how = {"model": model.model, "variant": variant, "split": split, "seed": model.seed}
        found.append(summarise(measured, **how, stream=(variant, split), by_source=False))
    return join(found)
