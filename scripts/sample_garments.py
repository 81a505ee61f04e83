"""Rule `sample_garments`: garments from the prior or near those of a type, as OBJ and glTF."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.models.gcvae.load import load_codec
from drapeline.models.gcvae.sample import draw_requests, load_types, sample_garments, save_samples
from drapeline.models.training.module import BEST
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    model = load_codec(Path(snakemake.input.model) / BEST)
    types = load_types(snakemake.input.model)
    bodies = {gender: load_body(snakemake.input[gender]) for gender in GENDERS}
    seed = snakemake.params.seed
    requests = draw_requests(seed, **snakemake.params.conditions)
    sampled = sample_garments(model, types, requests, seed, settle=snakemake.params.settle)
    rows = save_samples(snakemake.output[0], sampled, bodies, model.body_template.faces["body"])
    good = sum(row["inside_1cm_share"] <= 0.05 for row in rows)
    log.info(
        "%d of %d garments have at most 5 %% of their vertices deeper than 1 cm", good, len(rows)
    )
