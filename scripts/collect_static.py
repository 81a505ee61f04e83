"""Rule `collect_static`: all registered static garments as mapped arrays, with statistics."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.learning_data.static import collect_static
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    bodies = {gender: load_body(snakemake.input[gender]) for gender in GENDERS}
    count = collect_static(
        snakemake.output[0],
        [f"{shard}/offsets.npz" for shard in snakemake.input.registrations],
        bodies,
    )
    log.info("%d garments", count)
