"""Rule `evaluate_baselines`: what trivial predictions of static garments reach."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.bodies.rest_body import rest_body
from drapeline.frames import GENDERS
from drapeline.learning_data.static import StaticData
from drapeline.metrics.baselines import static_baseline_summary
from drapeline.metrics.registered import Truth
from drapeline.metrics.table import write_metrics
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.topology import load_topology
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    data = StaticData(snakemake.input.data)
    bodies = {gender: load_body(snakemake.input[gender]) for gender in GENDERS}
    topology = load_topology(snakemake.input.topology)
    truth = Truth(
        data.offsets,
        data.mask,
        body=lambda row: rest_body(bodies[data.gender[row]], data.shape[row]),
        faces=lambda row: topology.faces_of(GARMENTS[data.garment[row]]),
        body_faces=topology.faces,
    )
    rows = static_baseline_summary(
        truth,
        data,
        snakemake.params.splits,
        components=snakemake.params.components,
        seed=snakemake.params.seed,
    )
    write_metrics(snakemake.output[0], rows)
