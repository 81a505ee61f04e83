"""Rule `simulate_outfit`: simulate one outfit on one moving body, and judge the result."""

from importlib import import_module
from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.bodies.sequence import load_body_sequence
from drapeline.outfits.outfit import load_outfit
from drapeline.rule_log import rule_log
from drapeline.simulation.settings import HealthBounds, SimulationSettings
from drapeline.simulation.simulate import DressedBody, simulate_outfit

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    params = snakemake.params
    module = import_module(params.solver)
    solver = module.cloth_solver(snakemake.threads, params.accelerator)
    status = simulate_outfit(
        snakemake.output[0],
        DressedBody(
            load_body(snakemake.input.body),
            load_body_sequence(snakemake.input.animation),
            load_outfit(snakemake.input.outfit, snakemake.input.parameters),
        ),
        solver,
        settings=SimulationSettings(**params.settings),
        bounds=HealthBounds(**params.bounds),
    )
    log.info("%s %s", status["status"], status["reason"])
