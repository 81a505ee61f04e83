"""Rule `reconstruct_garment`: a garment from a user's point clouds, as a CLOTH3D sample."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.dataset.info_mat import SampleInfo
from drapeline.dataset.scans import read_scans
from drapeline.dataset.writer import MovingGarment, write_reconstructed
from drapeline.frames import GENDERS
from drapeline.mesh import Mesh
from drapeline.nets.garment4d.data import SequenceData
from drapeline.nets.garment4d.inference import reconstruct, refine, training_habits
from drapeline.nets.garment4d.refine import RefineSettings
from drapeline.nets.garment4d.training import PosedStage, load_stage, settings_of
from drapeline.nets.garment4d.wearers import Wearers
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given, params = snakemake.input, snakemake.params
    bodies = {gender: load_body(given[gender]) for gender in GENDERS}
    scans = read_scans(given.points, given.body, bodies, up=params.up)
    stage, body = load_stage(given.model, PosedStage), scans.body
    points = scans.points(params.points, seed=params.seed)
    gender = GENDERS.index(body.gender)
    wearers = Wearers(bodies, params.body_points)
    wearer = wearers.of(gender, body.shape)
    made = reconstruct(stage, points, body.poses, wearer)
    faces = stage.space.faces
    refining = settings_of(RefineSettings, params.refine)
    habits = training_habits(SequenceData(given.data, wearers), stage.settings.skinning)
    final = refine(made, points, body.poses, wearer, stage.label, faces, refining, habits)
    write_reconstructed(
        snakemake.output[0],
        bodies[body.gender],
        SampleInfo(
            poses=body.poses,
            trans=body.trans,
            shape=body.shape,
            gender=gender,
            outfit={params.garment: {"texture": {"type": "color", "data": params.colour}}},
        ),
        [MovingGarment(params.garment, Mesh(made.canonical, faces), final)],
    )
    log.info("%s in %d frames", params.garment, len(final))
