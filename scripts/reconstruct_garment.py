"""Rule `reconstruct_garment`: a garment from a user's point clouds, as a CLOTH3D sample."""

from typing import TYPE_CHECKING

from drapeline.dataset.info_mat import SampleInfo
from drapeline.dataset.scans import read_scans
from drapeline.dataset.writer import GarmentAnimation, write_reconstruction
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.table import write_metrics
from drapeline.models.garment4d.ours.model import OurModel
from drapeline.models.garment4d.scans import reconstruct_scans
from drapeline.registration.settings import RefineSettings
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given, params, made = snakemake.input, snakemake.params, snakemake.output
    model = OurModel(given.model)
    model.refining = RefineSettings(**params.refine)
    bodies = model.bodies.models
    scans = read_scans(given.points, given.body, bodies, up=params.up, fps=params.fps)
    found = reconstruct_scans(scans, model, name=given.points, seed=params.seed)
    garment, seen = found.made, found.made.seen
    write_metrics(made.metrics, found.rows)
    found.shown.save(made.shown)
    write_reconstruction(
        made.sample,
        bodies[seen.body.gender],
        SampleInfo(
            poses=seen.poses,
            trans=seen.trans,
            shape=seen.body.shape,
            gender=seen.body.gender,
            outfit={params.garment: {"texture": {"type": "color", "data": params.colour}}},
        ),
        [
            GarmentAnimation(
                params.garment, Mesh(garment.canonical, model.space.faces), garment.final
            )
        ],
    )
    log.info("%s in %d frames", params.garment, len(garment.final))
