"""Metrics of garments at rest and in motion, encoded and decoded."""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import torch

from drapeline.bodies.model import BodyModel, load_bodies
from drapeline.bodies.rest_body import rest_body
from drapeline.job import Job
from drapeline.learning_data.dynamic import DynamicData
from drapeline.learning_data.moving import MovingGarment, load_moving
from drapeline.learning_data.static import StaticData
from drapeline.learning_data.training_rows import rows_like
from drapeline.metrics.baselines import (
    fit_training_pca,
    garment_baselines,
    static_baseline_summary,
)
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
from drapeline.models.compare import compare, fit_scans, move_garments
from drapeline.models.gcvae.codec import (
    CODES,
    Codes,
    GarmentCodec,
    decode_codes,
    encode_garments,
    encode_held_out,
    join_codes,
    save_codes,
)
from drapeline.models.gcvae.data import DynamicGarments, StaticGarments
from drapeline.models.gcvae.decode import decode_points, resolve_points, static_truth
from drapeline.models.gcvae.load import load_codec, load_dynamic_garments, load_training_codes
from drapeline.models.gcvae.movers import load_mover
from drapeline.models.gcvae.moving_baselines import (
    RIDGE_FILE,
    MovingBaselines,
    moving_baseline_summary,
)
from drapeline.models.gcvae.ppca import GarmentPpca
from drapeline.models.gcvae.representation import (
    CodeScanFitter,
    FitCode,
    GuessedOffsets,
    LearnedMover,
    OffsetPca,
    RegisteredOffsets,
    VaeCode,
)
from drapeline.models.registry import CODE_SIZES
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.super_body import mirror_of
from drapeline.registration.to_body.topology import Topology, load_topology
from drapeline.rule_log import progress
from drapeline.schema import Table

# Of a variant whose garments were pushed out of the body, and of one that does not see the frame:
# its code is the mean of the prior.
RESOLVED_SUFFIX, PRIOR_SUFFIX = "_settled", "_prior"


def rows_to_measure(garments: StaticGarments, splits: Sequence[str]) -> dict[str, np.ndarray]:
    """Split -> rows; of "train" at most as many of each type as of the first split."""
    found = {split: garments.rows(split) for split in splits}
    if "train" in found:
        kinds, wanted = (garments.garment[found[name]] for name in ("train", splits[0]))
        found["train"] = found["train"][rows_like(kinds, wanted)]
    return found


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
    for split, rows in rows_to_measure(garments, splits).items():
        own = codes.of(rows)
        measures = measure_static(model, garments, rows, own)
        measured = measured_at_rest(garments, rows, measures)
        tables.append(_summarise(model, measured, variant, split, own, by_source=False))
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

    One that sees the frame has rows of what it decodes from the mean of the prior, too; one that
    resolves penetration, of its garments before and after that.

    Args:
        garments: every frame that is measured.
        held_out: split -> the same garments with their simulation and skinning weights.
        bodies: super-resolved, by gender.
        variant: name of the model in the table.
    """
    tables = []
    for split, movings in held_out.items():
        measured: dict[str, list[Measured]] = {}
        seen: list[Codes] = []
        for moving in progress(movings, label=split):
            rows = garments.data.rows_of(moving.sample, moving.name)
            body = bodies[moving.gender]
            decode = partial(decode_points, model, garments, rows, moving, body)
            prior = decode(np.zeros((len(rows), model.latent), dtype=np.float32))
            codes, decoded = None, {variant: prior}
            if model.sees_frame:
                codes = encode_garments(model, garments, rows)
                seen.append(codes)
                decoded = {variant: decode(codes.mean), variant + PRIOR_SUFFIX: prior}
            frames = garments.data.frame[rows]
            if model.resolves_penetration:
                poses = moving.poses[frames]
                resolved = resolve_points(moving, body, topology, decoded[variant], poses)
                decoded[variant + RESOLVED_SUFFIX] = resolved
            for name, cloth in decoded.items():
                measures = measure_motion(moving, frames, cloth, body, topology)
                if codes and not name.endswith(PRIOR_SUFFIX):
                    measures = add_kl(measures, codes.kl_nat())
                measured.setdefault(name, []).extend(measured_in_motion(moving, measures))
        for name, frames in measured.items():
            own = join_codes(seen) if seen and not name.endswith(PRIOR_SUFFIX) else None
            tables.append(_summarise(model, frames, name, split, own))
    return join(tables)


def _summarise(
    model: GarmentCodec,
    measured: Sequence[Measured],
    variant: str,
    split: str,
    codes: Codes | None,
    *,
    by_source: bool = True,
) -> Table:
    """Rows of a variant; `codes` of what was measured, or None if all have the prior's mean."""
    return summarise(
        measured,
        model=model.model,
        variant=variant,
        split=split,
        seed=model.seed,
        stream=(variant, split),
        by_source=by_source,
        of_all={"active_units": codes.active_units()} if codes else None,
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
    mirror = mirror_of(data.body_mean.astype(np.float64), topology.faces)
    pca = fit_training_pca(data, mirror, components=params.components, seed=params.seed)
    splits = rows_to_measure(data, params.splits)
    rows = static_baseline_summary(truth, data, splits, pca, seed=params.seed)
    write_evaluation(job.output[0], rows)


def evaluate_dynamic_baselines(job: Job) -> None:
    """What predictions without a network reach in motion, and the penalty of the regression."""
    given, params = job.input, job.params
    baselines = MovingBaselines(
        load_dynamic_garments(given.data, given.static, params.frames),
        load_codec(Path(given.static) / BEST).body_template.mirror,
        components=params.components,
        seed=params.seed,
    )
    rows = moving_baseline_summary(
        baselines,
        load_moving(given.samples, given.registrations, params.splits),
        load_bodies(given),
        load_topology(given.topology),
        seed=params.seed,
    )
    write_evaluation(job.output[0], rows, lambda made: baselines.ridge.save(made / RIDGE_FILE))


def evaluate_static(job: Job) -> None:
    """Codes of all static garments, and metrics of their reconstructions."""
    given, params = job.input, job.params
    model, data = load_codec(Path(given.model) / BEST), StaticData(given.data)
    codes = encode_held_out(model, data, load_training_codes(given.model).codes)
    rows = static_rows(model, data, codes, params.variant, params.splits)
    write_evaluation(job.output[0], rows, lambda made: save_codes(made / CODES, codes, data))


def evaluate_dynamic(job: Job) -> None:
    """Metrics of garments in motion, reconstructed or predicted."""
    given, params = job.input, job.params
    rows = dynamic_rows(
        load_codec(Path(given.model) / BEST),
        load_dynamic_garments(given.data, given.static, params.frames),
        load_moving(given.samples, given.registrations, params.splits),
        load_bodies(given),
        load_topology(given.topology),
        params.variant,
    )
    write_evaluation(job.output[0], rows)


def compare_codes(job: Job) -> None:
    """Held-out garments as offsets, PCA and codes of the garment VAEs, PCA also in short codes."""
    given, params = job.input, job.params
    data = StaticData(given.data)
    codecs = {Path(folder).name: load_codec(Path(folder) / BEST) for folder in given.models}
    template = next(iter(codecs.values())).body_template
    pca = fit_training_pca(data, template.mirror, components=params.components, seed=params.seed)
    components, own = {"body_pca": pca}, list(codecs.items())
    for count in CODE_SIZES:
        if len(pca.axes) > count:
            components[f"body_pca_{count}"] = pca.first(count)
        for name, model in own:
            if isinstance(model, GarmentPpca) and model.latent > count:
                codecs[f"{name}_{count}"] = model.first(count)
    guesses = garment_baselines(data)
    compare(
        job,
        [
            RegisteredOffsets(data, template),
            *(OffsetPca(variant, one, data, template) for variant, one in components.items()),
            *(VaeCode(variant, model, data) for variant, model in codecs.items()),
            *(GuessedOffsets(variant, one, data, template) for variant, one in guesses.items()),
        ],
    )


def compare_other_codes(job: Job) -> None:
    """Held-out garments as codes of garment VAEs whose codes are of other sizes."""
    data = StaticData(job.input.data)
    codecs = {Path(folder).name: load_codec(Path(folder) / BEST) for folder in job.input.models}
    compare(job, [VaeCode(variant, model, data) for variant, model in codecs.items()])


def fit_codes_to_scans(job: Job) -> None:
    """Codes of garment VAEs and masked PCA for held-out scans."""
    torch.set_num_threads(job.threads)
    bodies = load_bodies(job.input)
    codecs = {f"{Path(path).name}_scan": load_codec(Path(path) / BEST) for path in job.input.models}
    fit_scans(job, CodeScanFitter(codecs, bodies, FitCode()), bodies)


def move_garments_at_rest(job: Job) -> None:
    """True garments at rest, moved by what models of garments in motion have learned."""
    torch.set_num_threads(job.threads)
    given, bodies = job.input, load_bodies(job.input)
    models = {f"moved_{Path(path).name}": load_mover(path) for path in given.models}
    static = load_codec(Path(given.static) / BEST)
    mover = LearnedMover(models, static, DynamicData(given.data), bodies)
    move_garments(job, mover, bodies)
