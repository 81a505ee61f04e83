"""Rule `fit_learning_templates`: garments of the learning group registered to templates at rest."""

from typing import TYPE_CHECKING

from drapeline.dataset.shards import samples_of_shards
from drapeline.registration.settings import TemplateFitSettings
from drapeline.registration.to_template.garment_template import load_template
from drapeline.registration.to_template.template_tables import garments_of_sample, write_tables
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    count = write_tables(
        snakemake.output[0],
        [
            garment
            for sample in samples_of_shards([snakemake.input.samples])
            for garment in garments_of_sample(sample)
        ],
        {garment: load_template(snakemake.input[garment]) for garment in snakemake.params.garments},
        TemplateFitSettings(**snakemake.params.settings),
    )
    log.info("%d garments", count)
