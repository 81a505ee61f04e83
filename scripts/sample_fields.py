"""Rule `sample_fields`: distances around the garments of a shard, and the skin they cover."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.learning_data.garment_fields import sample_fields
from drapeline.learning_data.occlusion import texture_pixels
from drapeline.outfits.static import load_static
from drapeline.rule_log import rule_log
from drapeline.storage import save_npz

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given, params = snakemake.input, snakemake.params
    bodies = {gender: load_body(given[gender]) for gender in GENDERS}
    fields = sample_fields(
        load_static(given.outfits),
        bodies,
        texture_pixels(bodies[GENDERS[0]], params.resolution),
        params.boxes,
        seed=params.seed,
        near=params.near,
        space=params.space,
    )
    save_npz(snakemake.output[0], **fields)
    log.info("%d garments", len(fields["garment"]))
