"""Rule `evaluate_static`: codes of all static garments, and metrics of their reconstructions."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.learning_data.static import StaticData
from drapeline.metrics.table import write_metrics
from drapeline.models.gcvae.codec import encode_held_out, save_codes
from drapeline.models.gcvae.evaluate import evaluate_static
from drapeline.models.gcvae.load import load_codec, load_training_codes
from drapeline.models.training.module import BEST
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    model = load_codec(Path(snakemake.input.model) / BEST)
    data = StaticData(snakemake.input.data)
    codes = encode_held_out(model, data, load_training_codes(snakemake.input.model).codes)
    save_codes(snakemake.output.codes, codes, data)
    splits, variant = snakemake.params.splits, snakemake.wildcards.static
    write_metrics(snakemake.output.metrics, evaluate_static(model, data, codes, variant, splits))
