"""Rule `make_outfit`: a unique outfit, cut, resized and sewn for one body."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.bodies.sequence import load_body_sequence
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.generation.outfit import Wearer, dress
from drapeline.generation.settings import OutfitSettings
from drapeline.outfits.settings import OwnGarment
from drapeline.outfits.templates import load_templates
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given, params = snakemake.input, snakemake.params
    own = {name: OwnGarment(**given) for name, given in params.own_garments.items()}
    outfit = dress(
        SamplePlan(**params.plan),
        load_body_sequence(given.animation),
        Wearer(load_body(given.body), load_templates(given.templates), own),
        OutfitSettings(**params.settings),
        params.seed,
    )
    outfit.save(snakemake.output.arrays, snakemake.output.parameters)
    for garment in outfit.garments:
        log.info("%s: %d vertices", garment.name, len(garment.vertices))
