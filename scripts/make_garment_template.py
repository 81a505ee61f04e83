"""Rule `make_garment_template`: the mesh that all garments of a type are registered to."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.outfits.templates import load_templates
from drapeline.registration.to_template.garment_template import make_template, template_from_mesh
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given, garment = snakemake.input, snakemake.wildcards.garment
    bodies = {gender: load_body(given[f"{gender}_body"]) for gender in GENDERS}
    own = given.get("own")
    if own is None:
        templates = {gender: load_templates(given[f"{gender}_templates"]) for gender in GENDERS}
        template = make_template(garment, templates, bodies, snakemake.params.edge_length_m)
    else:
        template = template_from_mesh(garment, own, bodies[GENDERS[0]])
    template.save(snakemake.output[0])
    log.info("%s: %d vertices, %d faces", garment, len(template.vertices), len(template.faces))
