"""Samples that are simulated once more: how far garments in motion are from themselves.

Cloth that folds is not determined by what moves it: a millimetre at rest decides which way a fold
falls. What a simulation misses of itself, no prediction can be expected to reach.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, replace
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.bodies.sequence import load_body_sequence
from drapeline.dataset.record import read_meta, solver_name
from drapeline.geometry.point_cache import PointCache
from drapeline.job import Job
from drapeline.outfits.outfit import Outfit, load_outfit
from drapeline.rule_log import LOGGER
from drapeline.seeding import rng_for
from drapeline.simulation.simulate import DressedBody, measure_outfit
from drapeline.simulation.solver import Attempt, ClothSolver

# By the solver that the sample is of, and by another one.
REST_SHAPE, OTHER_SOLVER = "again_rest_shape", "again_other_solver"
REST_SHAPE_M = 0.001
_WAVES, _WAVELENGTH_M = 16, 0.2


class SampleAgain(NamedTuple):
    """A sample that was simulated again."""

    sample: str  # its id
    way: str  # `REST_SHAPE` or `OTHER_SOLVER`
    cloths: dict[str, np.ndarray]  # garment -> (F, V, 3) root-relative metres


def simulate_samples_again(
    job: Job, folders: Iterable[str | Path], bodies: Mapping[str, BodyModel]
) -> Iterator[SampleAgain]:
    """Samples as the fast solver simulates them: its own with another rest shape, others as is.

    Those that break down are left out, with a warning in the log.

    Args:
        job: its input has `outfits` and `motions`, folders of the shards that the samples are of;
            its params `solver` and `seed`.
        folders: of accepted samples.
        bodies: whole, by gender.
    """
    solver, seed = import_module(job.params.solver).cloth_solver(job.threads), job.params.seed
    outfits, motions = map(_by_name, (job.input.outfits, job.input.motions))
    for folder in folders:
        meta = read_meta(folder)
        name, own = meta["id"], solver_name(meta) == solver.name
        outfit = load_outfit(outfits[name], outfits[name].with_suffix(".json"))
        if own:
            outfit = change_rest_shape(outfit, REST_SHAPE_M, rng_for(seed, "rest shape", name))
        dressed = DressedBody(bodies[outfit.gender], load_body_sequence(motions[name]), outfit)
        cloths = simulate_again(dressed, solver, meta["simulation"]["attempts"][-1])
        if not cloths:
            LOGGER.warning("%s: broke down when it was simulated again, and is left out", name)
            continue
        LOGGER.info("%s: simulated again", name)
        yield SampleAgain(name, REST_SHAPE if own else OTHER_SOLVER, cloths)


def _by_name(shards: Iterable[str]) -> dict[str, Path]:
    return {path.stem: path for shard in shards for path in sorted(Path(shard).glob("*.npz"))}


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
