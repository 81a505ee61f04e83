"""Rule `build_templates`: the dress form that one gender's garments are cut on."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.outfits.templates import build_templates
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    build_templates(load_body(snakemake.input.body)).save(snakemake.output[0])
