"""Rule `fit_templates`: garments of a shard registered to their types' templates at rest."""

from typing import TYPE_CHECKING

from drapeline.registration.settings import TemplateFitSettings
from drapeline.registration.to_template.garment_template import load_template
from drapeline.registration.to_template.remesh import garments_at_rest, write_tables
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given, params = snakemake.input, snakemake.params
    count = write_tables(
        snakemake.output[0],
        garments_at_rest(given.shard, simulated=params.simulated),
        snakemake.wildcards.garment,
        load_template(given.template),
        TemplateFitSettings(**params.settings),
    )
    log.info("%d garments", count)
