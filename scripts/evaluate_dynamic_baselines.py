"""Rule `evaluate_dynamic_baselines`: what trivial predictions of garments in motion reach."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.learning_data.moving import load_moving
from drapeline.metrics.baselines import moving_baseline_summary
from drapeline.metrics.table import write_metrics
from drapeline.registration.to_body.topology import load_topology
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    files = snakemake.input.samples, snakemake.input.registrations
    rows = moving_baseline_summary(
        load_moving(*files, "train"),
        {split: load_moving(*files, split) for split in snakemake.params.splits},
        {gender: load_body(snakemake.input[gender]) for gender in GENDERS},
        load_topology(snakemake.input.topology),
        step=snakemake.params.step,
        seed=snakemake.params.seed,
    )
    write_metrics(snakemake.output[0], rows)
