"""Rule `fit_static_templates`: static garments of a shard registered to their types' templates."""

from typing import TYPE_CHECKING

from drapeline.outfits.static import load_static
from drapeline.registration.settings import TemplateFitSettings
from drapeline.registration.to_template.garment_template import load_template
from drapeline.registration.to_template.template_tables import NamedGarment, write_tables
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    count = write_tables(
        snakemake.output[0],
        [
            NamedGarment(name, garment.name, garment.vertices, garment.faces)
            for name, _, outfit in load_static(snakemake.input.outfits)
            for garment in outfit.garments
        ],
        {garment: load_template(snakemake.input[garment]) for garment in snakemake.params.garments},
        TemplateFitSettings(**snakemake.params.settings),
    )
    log.info("%d garments", count)
