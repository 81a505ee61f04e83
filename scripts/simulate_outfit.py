"""Rule `simulate_outfit`: drape one outfit on one moving body in Blender, and judge the result."""

from typing import TYPE_CHECKING

from drapeline.blender.threads import seen_cores
from drapeline.bodies.model import load_body
from drapeline.bodies.sequence import load_body_sequence
from drapeline.outfits.outfit import load_outfit
from drapeline.rule_log import rule_log
from drapeline.simulation.health import HealthBounds
from drapeline.simulation.settings import SimulationSettings

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    with seen_cores(snakemake.threads):
        from drapeline.blender.simulate import simulate_outfit
    status = simulate_outfit(
        snakemake.output[0],
        body=load_body(snakemake.input.body),
        body_record=load_body_sequence(snakemake.input.animation),
        outfit=load_outfit(snakemake.input.outfit, snakemake.input.parameters),
        settings=SimulationSettings(**snakemake.params.settings),
        bounds=HealthBounds(**snakemake.params.bounds),
    )
    log.info("%s %s", status["status"], status["reason"])
