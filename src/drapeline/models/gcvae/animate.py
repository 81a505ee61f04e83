"""Sampled outfits in motion: drawn, hung on a wearer, moved in several ways, and measured."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path

import numpy as np

from drapeline.bodies.model import BodyModel, load_bodies
from drapeline.bodies.sequence import BodySequence
from drapeline.dataset.gltf import write_glb
from drapeline.dataset.reader import Sample
from drapeline.dataset.sample_meshes import scene_parts
from drapeline.errors import InputError
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.generation.body import animate
from drapeline.generation.moving_outfits import SimulatedOutfit, write_outfit
from drapeline.generation.moving_sheets import (
    WORN,
    SimulatedSheet,
    job_draper,
    simulate_sheets,
)
from drapeline.generation.settings import BodySettings
from drapeline.job import Job
from drapeline.models.gcvae.codec import GarmentCodec
from drapeline.models.gcvae.load import load_codec
from drapeline.models.gcvae.movers import WornSheet, hang_at_rest, load_mover, move_by_model
from drapeline.models.gcvae.sample import (
    GarmentTypes,
    Request,
    SampledGarment,
    load_types,
    sample_garments,
)
from drapeline.models.gcvae.settings import SOLVER
from drapeline.models.training.module import BEST
from drapeline.motions.motion import load_motion
from drapeline.outfits.garment_types import layered
from drapeline.outfits.worn import DrapedSheet
from drapeline.report.colours import garment_colour
from drapeline.report.dataset.viewer import write_side_by_side
from drapeline.rule_log import LOGGER, progress
from drapeline.seeding import rng_for
from drapeline.simulation.health import HealthMonitor, summary, watch_mesh
from drapeline.simulation.settings import SimulationSettings
from drapeline.storage import atomic_folder, read_rows, write_rows

TABLE = "outfits.tsv"
# Of `health.summary`, what tells of every mover.
_MEASURES = (
    *("inside_share_mean", "depth_m", "self_crossings_max", "layer_crossings_max"),
    *("stretch_low", "stretch_high", "acceleration_m_s2"),
)


def animate_outfits(job: Job) -> None:
    """Outfits of drawn codes on a clip, moved in several ways: samples, glTF and a table.

    Raises:
        InputError: nobody can move through the clip without overlapping, a file is damaged, or no
            training garment is of a type.
    """
    given, params = job.input, job.params
    model, types = load_codec(Path(given.model) / BEST), load_types(given.model)
    static = load_codec(Path(given.static) / BEST)
    movers = {name: load_mover(given[name]) for name in params.movers if name != SOLVER}
    bodies, motion = load_bodies(given), load_motion(given.motion)
    draper, rows = job_draper(job, params.hang_frames), []
    plans = [SamplePlan(**plan) for plan in params.plans]
    with atomic_folder(job.output[0]) as scratch:
        for plan in progress(plans, total=len(plans), label="outfits"):
            body = bodies[plan.gender]
            record = animate(plan, motion, body, BodySettings(**params.bodies), params.seed)
            if record.outcome == "rejected":
                raise InputError(f"{motion.sequence}: {record.reason}, expected another clip")
            drawn = draw_outfit(
                model,
                types,
                plan,
                record.shape,
                params.seed,
                params.tightness,
                params.tightness_range,
                settle=params.settle,
            )
            meshes = {kind: one.mesh for kind, one in drawn.items()}
            if empty := [kind for kind, mesh in meshes.items() if not len(mesh.faces)]:
                LOGGER.warning("%s: a code of %s decodes to nothing", plan.sample, empty[0])
                continue
            hung = hang_at_rest(meshes, body, plan.gender, record.shape, draper)
            moved = {}
            for name in params.movers:
                LOGGER.info("%s: %s by %s", plan.sample, plan.outfit_type, name)
                if name == SOLVER:
                    sheets = _simulate(job, hung, body, record)
                else:
                    sheets = move_by_model(
                        movers[name],
                        static,
                        {
                            kind: WornSheet(
                                hung[kind].rest,
                                hung[kind].posed,
                                one.offsets,
                                one.mask,
                                one.request.cvar,
                            )
                            for kind, one in drawn.items()
                        },
                        body,
                        record,
                        settle=params.settle,
                    )
                if sheets:
                    moved[name] = SimulatedOutfit.of(sheets, body, record)
            for name, worn in moved.items():
                sample = scratch / f"{plan.sample}_{name}"
                write_outfit(sample, worn, {kind: garment_colour(kind) for kind in worn.garments})
                with Sample(sample) as opened:
                    write_glb(sample.with_suffix(".glb"), scene_parts(opened))
                about = {"name": plan.sample, "outfit": plan.outfit_type, "gender": plan.gender}
                about |= {"clip": plan.sub_sequence, "mover": name}
                rows.append({**about, **measure(worn, moved.get(SOLVER))})
        write_rows(scratch / TABLE, rows)


def show_animated(job: Job) -> None:
    """Pages on which an outfit moves in several ways, side by side."""
    folder = Path(job.input.animated)
    _, rows = read_rows(folder / TABLE, "a table of outfits in motion")
    for name in job.params.names:
        own = [row for row in rows if row["name"] == name]
        lines = [f"{own[0]['outfit']}, {own[0]['gender']}, {own[0]['clip']}"] if own else []
        write_side_by_side(
            job.output[name],
            {row["mover"]: folder / f"{name}_{row['mover']}" for row in own},
            f"{name}, a sampled outfit" if own else f"Nothing moved {name}",
            lines,
        )


def draw_outfit(
    model: GarmentCodec,
    types: GarmentTypes,
    plan: SamplePlan,
    shape: np.ndarray,
    seed: int,
    tightness: Sequence[float] | None,
    tightness_range: Sequence[float],
    *,
    settle: bool,
) -> dict[str, SampledGarment]:
    """Garment type -> a sampled garment, from the innermost to the outermost, for one wearer.

    Args:
        plan: who wears what.
        shape: (10,) of the wearer.
        tightness: (2,) of all garments; None draws it from the range.
        settle: see `sample_garments`.
    """
    low, high = tightness_range
    some = rng_for(seed, "sampled outfit", plan.sample).uniform(low, high, 2)
    chosen = some if tightness is None else np.asarray(tightness)
    requests = {
        f"{plan.sample}/{name}": Request(name, plan.gender, shape, chosen)
        for name in layered(plan.outfit_type.split("+"))
    }
    sampled = sample_garments(model, types, requests, seed, settle=settle)
    return {one.garment: one for one in sampled}


def _simulate(
    job: Job, hung: Mapping[str, DrapedSheet], body: BodyModel, record: BodySequence
) -> dict[str, SimulatedSheet]:
    """Garments by the fast solver; none where the simulation is out of bounds, which is logged."""
    try:
        return simulate_sheets(
            {name: sheet.rest for name, sheet in hung.items()},
            body,
            record,
            import_module(job.params.solver).cloth_solver(job.threads),
            edge_length_m=None,
            simulation=SimulationSettings(**job.params.hanging["simulation"]),
            bounds=WORN,
        )
    except InputError as error:
        LOGGER.warning("%s", error)
        return {}


def measure(worn: SimulatedOutfit, reference: SimulatedOutfit | None) -> dict[str, float]:
    """Health of the worst garment, and the mean distance of vertices from a reference in mm."""
    garments = worn.garments
    monitor = HealthMonitor(
        [watch_mesh(name, one.rest.vertices, one.rest.faces) for name, one in garments.items()],
        worn.model.faces,
    )
    for frame, surface in enumerate(worn.body):
        cloths = [one.frames[frame].vertices for one in garments.values()]
        monitor.add(cloths, surface.vertices)
    found = {name: value for name, value in summary(monitor.arrays()).items() if name in _MEASURES}
    if reference:
        away = [
            np.linalg.norm(mine.vertices - its.vertices, axis=1)
            for name, one in garments.items()
            for mine, its in zip(one.frames, reference.garments[name].frames, strict=True)
        ]
        found["from_solver_mm"] = 1e3 * float(np.concatenate(away).mean())
    return found
