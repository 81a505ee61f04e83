"""Rule `train_smplicit`: SMPLicit's decoder, image encoder and styles for some garment types."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.learning_data.garment_fields import FieldData
from drapeline.models.smplicit.model import save_model_files
from drapeline.models.smplicit.network import new_field
from drapeline.models.smplicit.settings import FieldSettings
from drapeline.models.smplicit.train import train_field
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params = snakemake.input, snakemake.params
    bodies = {gender: load_body(given[gender]) for gender in GENDERS}
    data = FieldData(given.data)
    model = new_field(snakemake.wildcards.field, data, bodies, FieldSettings(**params.settings))
    train_field(
        snakemake.output[0],
        model,
        data,
        code=params.code,
        progress=params.progress,
        trainer=params.trainer,
        threads=snakemake.threads,
        complete=lambda folder: save_model_files(folder, model, data, bodies),
    )
