"""Rule `evaluate_smplicit`: codes and surfaces of held-out garments, with their metrics."""

from typing import TYPE_CHECKING

import torch

from drapeline.learning_data.garment_fields import FieldData
from drapeline.metrics.table import write_metrics
from drapeline.models.smplicit.evaluate import FieldEvaluation, true_meshes
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.network import new_field
from drapeline.models.smplicit.representation import save_held_out
from drapeline.models.smplicit.settings import FieldFitSettings, Meshing
from drapeline.outfits.static import load_static
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params = snakemake.input, snakemake.params
    torch.set_num_threads(snakemake.threads)
    model, data = SmplicitModel(given.model), FieldData(given.data)
    outfits = [outfit for shard in given.outfits for outfit in load_static(shard)]
    evaluation = FieldEvaluation(
        model,
        data,
        true_meshes(data, outfits),
        meshing=Meshing(**params.meshing),
        fit=FieldFitSettings(**params.fit),
        seed=params.seed,
    )
    untrained = new_field(model.name, data, model.bodies, model.network.settings).eval()
    rows, held_out = evaluation.run(params.split, untrained)
    write_metrics(snakemake.output.metrics, rows)
    save_held_out(snakemake.output.held_out, held_out)
