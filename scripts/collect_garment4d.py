"""Rule `collect_garment4d`: sequences of one garment type in its template's topology, as arrays."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.dataset.shards import samples_of_shards
from drapeline.frames import GENDERS
from drapeline.learning_data.sequence_sources import simulated_sequences, skinned_sequences
from drapeline.learning_data.sequences import collect_sequences
from drapeline.registration.to_template.garment_template import load_template
from drapeline.registration.to_template.remesh_table import load_tables
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given, params, garment = snakemake.input, snakemake.params, snakemake.wildcards.garment
    bodies = {gender: load_body(given[gender]) for gender in GENDERS if params.body_relative_points}
    tables = load_tables(given.fits, garment)
    learned = {path.name: path for path in samples_of_shards(given.learning)}
    clouds = samples_of_shards(given.learning_clouds)
    frames = collect_sequences(
        snakemake.output[0],
        garment,
        [
            *simulated_sequences(garment, given.samples, given.clouds, tables),
            *simulated_sequences(garment, [learned[path.name] for path in clouds], clouds, tables),
            *skinned_sequences(garment, given.skinned, given.shards, tables),
        ],
        load_template(given.template).faces,
        params.components,
        bodies or None,
    )
    log.info("%d frames", frames)
