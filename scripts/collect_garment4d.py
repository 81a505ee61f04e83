"""Rule `collect_garment4d`: sequences of one garment type in its template's topology, as arrays."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.dataset.shards import samples_named, samples_of
from drapeline.frames import GENDERS
from drapeline.learning_data.sequence_sources import simulated_sequences, skinned_sequences
from drapeline.learning_data.sequences import collect_sequences
from drapeline.registration.to_template.garment_template import load_template
from drapeline.registration.to_template.remesh import load_tables
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given, params, garment = snakemake.input, snakemake.params, snakemake.wildcards.garment
    bodies = {gender: load_body(given[gender]) for gender in GENDERS if params.body_relative_points}
    tables = load_tables(given.fits, garment)
    clouds = samples_of(given.clouds)
    samples = samples_named(given.samples, [path.name for path in clouds])
    frames = collect_sequences(
        snakemake.output[0],
        garment,
        [
            *simulated_sequences(garment, samples, clouds, tables),
            *skinned_sequences(garment, given.skinned, given.outfits, tables),
        ],
        load_template(given.template).faces,
        params.components,
        bodies or None,
    )
    log.info("%d frames", frames)
