"""Rule `make_outfit`: a unique outfit, cut, resized and sewn for one body."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.bodies.sequence import load_body_sequence
from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.generate import sample_outfit
from drapeline.outfits.own_garments import OwnGarment
from drapeline.outfits.templates import load_templates
from drapeline.rule_log import rule_log
from drapeline.seeding import rng_for

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    outfit = sample_outfit(
        rng_for(snakemake.params.seed, "outfit", snakemake.wildcards.sample),
        load_templates(snakemake.input.templates),
        load_body(snakemake.input.body),
        gender=snakemake.params.gender,
        shape=load_body_sequence(snakemake.input.animation).shape,
        outfit_type=snakemake.params.outfit_type,
        edge_length_m=snakemake.params.edge_length_m,
        vertices_min=snakemake.params.vertices_min,
        ranges=OutfitRanges(
            tightness=tuple(snakemake.params.tightness_range),
            elastic_chance=snakemake.params.elastic_probability,
        ),
        own={name: OwnGarment(**given) for name, given in snakemake.params.own_garments.items()},
    )
    outfit.save(snakemake.output.arrays, snakemake.output.parameters)
    for garment in outfit.garments:
        log.info("%s: %d vertices", garment.name, len(garment.vertices))
