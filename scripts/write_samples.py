"""Rule `write_samples`: simulated samples, judged, tried again if need be, as CLOTH3D folders."""

from functools import cache
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.bodies.sequence import load_body_sequence
from drapeline.dataset.writer import write_sample
from drapeline.frames import GENDERS
from drapeline.outfits.outfit import load_outfit
from drapeline.rule_log import rule_log
from drapeline.seeding import rng_for
from drapeline.simulation.settings import HealthBounds, SimulationSettings
from drapeline.simulation.simulate import DressedBody, judge_outfit
from drapeline.storage import atomic_folder

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given, params = snakemake.input, snakemake.params

    @cache
    def solver():
        module = import_module(params.solver)
        return module.cloth_solver(snakemake.threads, params.accelerator)

    models = {gender: load_body(given[gender]) for gender in GENDERS}
    with atomic_folder(snakemake.output[0]) as folder:
        for sample, split in params.splits.items():
            record, arrays = (
                Path(path) / f"{sample}.npz" for path in (given.bodies, given.outfits)
            )
            outfit = load_outfit(arrays, arrays.with_suffix(".json"))
            dressed = DressedBody(models[outfit.gender], load_body_sequence(record), outfit)
            with TemporaryDirectory(dir=folder, prefix=".further-") as further:
                judged = judge_outfit(
                    Path(given.simulations) / sample,
                    further,
                    dressed,
                    solver,
                    SimulationSettings(**params.settings),
                    HealthBounds(**params.bounds),
                )
                write_sample(
                    rng_for(params.seed, "scene", sample),
                    folder / sample,
                    body=dressed.body,
                    body_record=record,
                    outfit=arrays,
                    simulation=judged.folder,
                    status=judged.status,
                    seed=params.seed,
                    split=split,
                )
            log.info("%s: %s %s", sample, judged.status["status"], judged.status["reason"])
