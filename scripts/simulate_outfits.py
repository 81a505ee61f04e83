"""Rule `simulate_outfits`: one attempt at simulating each outfit on its body, with all measures."""

from importlib import import_module
from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.bodies.sequence import load_body_sequence
from drapeline.frames import GENDERS
from drapeline.outfits.outfit import load_outfit
from drapeline.rule_log import rule_log
from drapeline.simulation.settings import SimulationSettings
from drapeline.simulation.simulate import DressedBody, measure_outfit
from drapeline.storage import atomic_folder

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given, params = snakemake.input, snakemake.params
    solver = import_module(params.solver).cloth_solver(snakemake.threads, params.accelerator)
    bodies = {gender: load_body(given[gender]) for gender in GENDERS}
    with atomic_folder(snakemake.output[0]) as folder:
        for sample in params.samples:
            outfit = load_outfit(f"{given.outfits}/{sample}.npz", f"{given.outfits}/{sample}.json")
            motion = load_body_sequence(f"{given.bodies}/{sample}.npz")
            measure_outfit(
                folder / sample,
                DressedBody(bodies[outfit.gender], motion, outfit),
                solver,
                settings=SimulationSettings(**params.settings),
            )
            log.info("%s: simulated", sample)
