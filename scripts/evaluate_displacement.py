"""Rule `evaluate_displacement`: held-out samples in motion, by displacement and skinning."""

from typing import TYPE_CHECKING

import torch

from drapeline.bodies.model import load_body
from drapeline.dataset.shards import samples_of_shards
from drapeline.frames import GENDERS
from drapeline.learning_data.garment_fields import load_clusters
from drapeline.learning_data.pose_displacements import DisplacementData, simulated_files
from drapeline.metrics.table import write_metrics
from drapeline.models.smplicit.displacement_baselines import ClusterDisplacement
from drapeline.models.smplicit.evaluate_displacement import DisplacementEvaluation
from drapeline.models.smplicit.load_displacement import load_displacement, new_displacement
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params = snakemake.input, snakemake.params
    torch.set_num_threads(snakemake.threads)
    bodies = {gender: load_body(given[gender]) for gender in GENDERS}
    data, clusters = DisplacementData(given.data), load_clusters(given.fields)
    network = load_displacement(given.model)
    untrained = new_displacement(network.name, data, bodies, clusters, network.settings)
    evaluation = DisplacementEvaluation(
        network,
        untrained.eval(),
        ClusterDisplacement(data, bodies, clusters),
        bodies,
        seed=params.seed,
    )
    held_out = simulated_files(
        [*given.samples, *samples_of_shards(given.learning)],
        params.garments,
        [params.split],
        frame_step=params.frame_step,
    )
    write_metrics(snakemake.output[0], evaluation.run(params.split, held_out))
