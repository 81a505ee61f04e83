"""Rule `compare_gcvae`: held-out garments as offsets, PCA and codes of the garment VAEs."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.learning_data.static import StaticData
from drapeline.metrics.table import write_metrics
from drapeline.models.compare import compare_representations, held_out_garments
from drapeline.models.gcvae.load import load_codec
from drapeline.models.gcvae.representation import OffsetPca, RegisteredOffsets, VaeCode
from drapeline.models.training.module import BEST
from drapeline.outfits.static import load_static
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params = snakemake.input, snakemake.params
    data = StaticData(given.data)
    models = {Path(folder).name: load_codec(Path(folder) / BEST) for folder in given.models}
    template = next(iter(models.values())).body_template
    outfits = (outfit for shard in given.outfits for outfit in load_static(shard))
    rows = compare_representations(
        held_out_garments(data, outfits, params.garments, params.split),
        [
            RegisteredOffsets(data, template),
            OffsetPca(data, template, params.components),
            *(VaeCode(variant, model, data) for variant, model in models.items()),
        ],
        split=params.split,
        seed=params.seed,
    )
    write_metrics(snakemake.output[0], rows)
