"""Rule `compare_smplicit`: held-out garments as codes of SMPLicit."""

from typing import TYPE_CHECKING

from drapeline.learning_data.static import StaticData
from drapeline.metrics.table import write_metrics
from drapeline.models.compare import compare_representations, held_out_garments
from drapeline.models.smplicit.representation import FieldCode
from drapeline.outfits.static import load_static
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params = snakemake.input, snakemake.params
    data = StaticData(given.data)
    outfits = (outfit for shard in given.outfits for outfit in load_static(shard))
    rows = compare_representations(
        held_out_garments(data, outfits, params.garments, params.split),
        [FieldCode(given.held_out)],
        split=params.split,
        seed=params.seed,
    )
    write_metrics(snakemake.output[0], rows)
