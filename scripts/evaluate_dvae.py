"""Rule `evaluate_dvae`: metrics of the reconstructions of garments in motion."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.metrics.motion import load_moving
from drapeline.metrics.table import write_metrics
from drapeline.nets.checkpoints import load_vae
from drapeline.nets.dynamic_data import dynamic_garments
from drapeline.nets.represent import dynamic_vae_summary
from drapeline.nets.trained import BEST
from drapeline.nets.variants import dynamic_conditions
from drapeline.registration.topology import load_topology
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given = snakemake.input
    variant = snakemake.wildcards.dvae
    _, frames = dynamic_conditions(variant)
    rows = dynamic_vae_summary(
        load_vae(Path(given.model) / BEST),
        dynamic_garments(given.data, given.static, frames),
        {
            split: load_moving(given.samples, given.registrations, split)
            for split in snakemake.params.splits
        },
        {gender: load_body(given[gender]) for gender in GENDERS},
        load_topology(given.topology),
        variant,
    )
    write_metrics(snakemake.output[0], rows)
