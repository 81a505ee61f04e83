"""How far garments in motion are from themselves when they are simulated once more.

Cloth that folds is not determined by what moves it: a millimetre at rest decides which way a fold
falls. What a simulation misses of itself, no prediction from poses can be expected to reach.
"""

from collections.abc import Mapping
from dataclasses import fields, replace
from importlib import import_module
from itertools import groupby
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from drapeline.bodies.model import load_bodies, load_body
from drapeline.bodies.sequence import load_body_sequence
from drapeline.dataset.record import read_meta
from drapeline.frames import GENDERS
from drapeline.geometry.point_cache import PointCache
from drapeline.job import Job
from drapeline.learning_data.moving import moving_files
from drapeline.metrics.metric import Measured
from drapeline.metrics.registered import measure_motion, measured_in_motion
from drapeline.metrics.table import join, summarise, write_evaluation
from drapeline.outfits.outfit import Outfit, load_outfit
from drapeline.registration.to_body.topology import load_topology
from drapeline.rule_log import LOGGER
from drapeline.seeding import rng_for
from drapeline.simulation.simulate import DressedBody, measure_outfit
from drapeline.simulation.solver import Attempt, ClothSolver

# Variants of the truth: by the solver that the sample is of, and by another one.
REST_SHAPE, OTHER_SOLVER = "again_rest_shape", "again_other_solver"
REST_SHAPE_M = 0.001
_WAVES, _WAVELENGTH_M = 16, 0.2


def change_rest_shape(outfit: Outfit, amplitude_m: float, rng: np.random.Generator) -> Outfit:
    """The outfit, each garment moved at rest along smooth waves, the same for all.

    Args:
        amplitude_m: root mean square over the vertices of a garment.
        rng: draws the waves.
    """
    ways, directions = rng.normal(size=(2, _WAVES, 3))
    numbers = 2 * np.pi / _WAVELENGTH_M * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    phases = rng.uniform(0, 2 * np.pi, _WAVES)

    def moved(vertices: np.ndarray) -> np.ndarray:
        away = np.cos(vertices.astype(np.float64) @ numbers.T + phases) @ directions
        size = np.sqrt((away**2).sum(axis=1).mean())
        return (vertices + amplitude_m * away / size).astype(vertices.dtype)

    garments = tuple(replace(one, vertices=moved(one.vertices)) for one in outfit.garments)
    return replace(outfit, garments=garments)


def simulate_again(
    dressed: DressedBody, solver: ClothSolver, attempt: Mapping[str, Any]
) -> dict[str, np.ndarray]:
    """Garment -> (F, V, 3) root-relative metres; none if the simulation broke down.

    Args:
        attempt: that the sample was accepted with, as its record has it.
    """
    settings = Attempt(**{field.name: attempt[field.name] for field in fields(Attempt)})
    with TemporaryDirectory() as name:
        folder = Path(name) / "again"
        record = measure_outfit(folder, dressed, solver, settings=settings)
        if record["attempt"] is None or record["attempt"]["failure"]:
            return {}
        found = {}
        for garment in dressed.outfit.garments:
            with PointCache(folder / f"{garment.name}.f32", len(garment.vertices)) as cache:
                found[garment.name] = cache.frames()
        return found


def evaluate_floor(job: Job) -> None:
    """How far test garments are from themselves when they are simulated again."""
    given, params = job.input, job.params
    bodies, topology = load_bodies(given), load_topology(given.topology)
    refined = {gender: load_body(given[f"super_{gender}"]) for gender in GENDERS}
    solver = import_module(params.solver).cloth_solver(job.threads)
    outfits, motions = (
        {path.stem: path for shard in shards for path in sorted(Path(shard).glob("*.npz"))}
        for shards in (given.outfits, given.motions)
    )
    measured: dict[str, list[Measured]] = {}
    files = moving_files(given.samples, given.registrations, [params.split])
    wanted = (one for one in files if one.sample in params.samples)
    for sample, worn in groupby(wanted, key=lambda one: one.sample):
        garments = list(worn)
        source, folder = garments[0].source, garments[0].folder
        outfit = load_outfit(outfits[sample], outfits[sample].with_suffix(".json"))
        if source == solver.name:
            rng = rng_for(params.seed, "rest shape", sample)
            outfit = change_rest_shape(outfit, REST_SHAPE_M, rng)
        dressed = DressedBody(bodies[outfit.gender], load_body_sequence(motions[sample]), outfit)
        cloths = simulate_again(dressed, solver, read_meta(folder)["simulation"]["attempts"][-1])
        if not cloths:
            LOGGER.warning("%s: broke down when it was simulated again, and is left out", sample)
            continue
        LOGGER.info("%s: simulated again", sample)
        variant = REST_SHAPE if source == solver.name else OTHER_SOLVER
        for one in garments:
            moving = one.load()
            frames = np.arange(0, len(moving.poses), params.step)
            points = moving.registered.points(cloths[one.name][frames])
            body = refined[moving.gender]
            measures = measure_motion(moving, frames, points, body, topology)
            measured.setdefault(variant, []).extend(measured_in_motion(moving, measures))
    rows = join(
        summarise(every, model="truth", variant=variant, split=params.split, seed=params.seed)
        for variant, every in measured.items()
    )
    write_evaluation(job.output[0], rows)
