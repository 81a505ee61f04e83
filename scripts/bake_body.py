"""Rule `bake_body`: the free Anny body in SMPL's format, one file per gender."""

from typing import TYPE_CHECKING

from drapeline.bodies.bake import LICENCE, VERSION, bake_bodies
from drapeline.bodies.model import save_body
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    for gender, body in bake_bodies(snakemake.params.seed, snakemake.params.population).items():
        save_body(snakemake.output[gender], body, version=VERSION, licence=LICENCE)
        log.info("%s: %d vertices, %d faces", body.name, len(body.v_template), len(body.faces))
