"""Rule `plot_smplicit`: held-out garments as SMPLicit gives them back."""

from typing import TYPE_CHECKING

from drapeline.learning_data.garment_fields import FieldData
from drapeline.models.smplicit.evaluate import rebuilt_garments, true_meshes
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.representation import load_held_out
from drapeline.models.smplicit.settings import Meshing
from drapeline.outfits.static import load_static
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.smplicit.figures import plot_rebuilt
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    given = snakemake.input
    outfits = [outfit for shard in given.outfits for outfit in load_static(shard)]
    shown = []
    for folder, fields, held_out in zip(given.models, given.data, given.held_out, strict=True):
        data = FieldData(fields)
        shown += rebuilt_garments(
            SmplicitModel(folder),
            data,
            true_meshes(data, outfits),
            load_held_out(held_out),
            Meshing(**snakemake.params.meshing),
        )
    plot_rebuilt(snakemake.output[0], shown)
