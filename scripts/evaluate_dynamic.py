"""Rule `evaluate_dynamic`: metrics of the reconstructions of garments in motion."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.learning_data.moving import load_moving
from drapeline.metrics.table import write_metrics
from drapeline.models.gcvae.evaluate import evaluate_dynamic
from drapeline.models.gcvae.load import load_codec, load_dynamic_garments
from drapeline.models.training.module import BEST
from drapeline.registration.to_body.topology import load_topology
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params = snakemake.input, snakemake.params
    rows = evaluate_dynamic(
        load_codec(Path(given.model) / BEST),
        load_dynamic_garments(given.data, given.static, params.frames),
        {split: load_moving(given.samples, given.registrations, split) for split in params.splits},
        {gender: load_body(given[gender]) for gender in GENDERS},
        load_topology(given.topology),
        snakemake.wildcards.dynamic,
    )
    write_metrics(snakemake.output[0], rows)
