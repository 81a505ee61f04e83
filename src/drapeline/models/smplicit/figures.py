"""Figures of SMPLicit that its own code is needed for."""

from importlib import import_module
from pathlib import Path

import numpy as np

from drapeline.bodies.model import load_bodies
from drapeline.bodies.sequence import first_frames, load_body_sequence
from drapeline.generation.moving_sheets import simulate_sheet
from drapeline.job import Job
from drapeline.learning_data.garment_fields import FieldData
from drapeline.metrics.predictions import WornGarment
from drapeline.models.smplicit.evaluate import rebuilt_garments, true_meshes
from drapeline.models.smplicit.gallery.files import load_gallery, worn_prototype
from drapeline.models.smplicit.gallery.motion import SKINNINGS, place_clip, save_clip, worn_clip
from drapeline.models.smplicit.gallery.plan import SHEETS, nearest_type
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.representation import HELD_OUT, load_held_out
from drapeline.models.smplicit.settings import Meshing
from drapeline.outfits.static import load_static
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.smplicit.figures import (
    animate_clip,
    plot_clip,
    plot_gallery,
    plot_rebuilt,
)
from drapeline.rule_log import LOGGER
from drapeline.simulation.settings import HealthBounds, SimulationSettings

_TITLES = {"nearest": "nearest vertex\n(the paper's)", "smoothed": "smoothed\nweights"}


def plot_held_out(job: Job) -> None:
    """Held-out garments beside what is rebuilt from their codes."""
    given = job.input
    outfits = [outfit for shard in given.outfits for outfit in load_static(shard)]
    shown = []
    for folder, fields, evaluated in zip(given.models, given.data, given.evaluated, strict=True):
        data = FieldData(fields)
        shown += rebuilt_garments(
            SmplicitModel(folder),
            data,
            true_meshes(data, outfits),
            load_held_out(Path(evaluated) / HELD_OUT),
            Meshing(**job.params.meshing),
        )
    with ray_share(job.params.rays):
        plot_rebuilt(job.output[0], shown)


def plot_sheets(job: Job) -> None:
    """The gallery of a model, sheet by sheet."""
    garments = load_gallery(job.input.gallery, load_bodies(job.input))
    with ray_share(job.params.rays):
        for sheet in SHEETS:
            plot_gallery(job.output[sheet], [g for g in garments if g.sheet == sheet])


def pose_garment(job: Job) -> None:
    """A garment of the gallery in motion: skinned, and simulated if it is asked for."""
    params = job.params
    model = SmplicitModel(job.input.model)
    record = load_body_sequence(f"{job.input.bodies}/{params.sample}.npz")
    name, z, garment = worn_prototype(
        job.input.gallery,
        model,
        Meshing(**params.meshing),
        gender=record.gender,
        shape=record.shape,
    )
    worn = garment, nearest_type(z, model.codes), model.bodies[record.gender], record

    def clip(frames: np.ndarray, skinning: str) -> list[WornGarment]:
        return worn_clip(*worn, frames, skinning=skinning, push_out=params.push_out)

    frames = np.arange(min(params.frames, len(record.poses)))
    shown = frames[np.linspace(0, len(frames) - 1, params.shown).astype(int)]
    rows = {_TITLES[skinning]: clip(shown, skinning) for skinning in SKINNINGS}
    simulated = []
    if params.simulate:
        simulated = simulate_sheet(
            *worn[:3],
            first_frames(record, len(frames)),
            import_module(params.solver).cloth_solver(job.threads),
            edge_length_m=params.edge_length_m,
            simulation=SimulationSettings(**params.simulation),
            bounds=HealthBounds(**params.bounds),
        )
    if simulated:
        moving = place_clip(simulated, *worn[1:], frames)
        rows["simulated"] = [moving[frame] for frame in shown]
    else:
        moving = clip(frames, params.skinning)
    save_clip(job.output.scene, moving)
    with ray_share(params.rays):
        animate_clip(job.output.moving, moving)
        plot_clip(job.output.sheet, rows)
    LOGGER.info("%s on %s, %d frames", name, record.labels.sequence, len(frames))
