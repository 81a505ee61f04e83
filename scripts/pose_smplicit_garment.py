"""Rule `pose_smplicit_garment`: a garment of a model through a clip, on its wearer."""

from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np

from drapeline.bodies.sequence import first_frames, load_body_sequence
from drapeline.generation.moving_sheets import simulate_sheet
from drapeline.models.smplicit.gallery.files import worn_prototype
from drapeline.models.smplicit.gallery.motion import SKINNINGS, place_clip, save_clip, worn_clip
from drapeline.models.smplicit.gallery.plan import nearest_type
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.settings import Meshing
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.smplicit.figures import animate_clip, plot_clip
from drapeline.rule_log import rule_log
from drapeline.simulation.settings import HealthBounds, SimulationSettings

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

_TITLES = {"nearest": "nearest vertex\n(the paper's)", "smoothed": "smoothed\nweights"}

with rule_log(snakemake.log[0]) as log, ray_share(snakemake.params.rays):
    wanted = snakemake.params
    model = SmplicitModel(snakemake.input.model)
    record = load_body_sequence(f"{snakemake.input.bodies}/{wanted.sample}.npz")
    wearer, meshing = {"gender": record.gender, "shape": record.shape}, Meshing(**wanted.meshing)
    name, z, garment = worn_prototype(snakemake.input.gallery, model, meshing, **wearer)
    worn = garment, nearest_type(z, model.codes), model.bodies[record.gender], record

    def clip(frames, skinning):
        return worn_clip(*worn, frames, skinning=skinning, push_out=wanted.push_out)

    frames = np.arange(min(wanted.frames, len(record.poses)))
    shown = frames[np.linspace(0, len(frames) - 1, wanted.shown).astype(int)]
    rows = {_TITLES[skinning]: clip(shown, skinning) for skinning in SKINNINGS}
    simulated = []
    if wanted.simulate:
        simulated = simulate_sheet(
            *worn[:3],
            first_frames(record, len(frames)),
            import_module(wanted.solver).cloth_solver(snakemake.threads),
            edge_length_m=wanted.edge_length_m,
            simulation=SimulationSettings(**wanted.simulation),
            bounds=HealthBounds(**wanted.bounds),
        )
    if simulated:
        moving = place_clip(simulated, *worn[1:], frames)
        rows["simulated"] = [moving[frame] for frame in shown]
    else:
        moving = clip(frames, wanted.skinning)
    save_clip(snakemake.output.scene, moving)
    animate_clip(snakemake.output.moving, moving)
    plot_clip(snakemake.output.sheet, rows)
    log.info("%s on %s, %d frames", name, record.labels.sequence, len(frames))
