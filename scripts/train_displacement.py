"""Rule `train_displacement`: what poses do to the garments of a model of SMPLicit."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.learning_data.garment_fields import load_clusters
from drapeline.learning_data.pose_displacements import DisplacementData
from drapeline.models.smplicit.displacement_settings import DisplacementSettings
from drapeline.models.smplicit.load_displacement import new_displacement
from drapeline.models.smplicit.train_displacement import train_displacement
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params = snakemake.input, snakemake.params
    data = DisplacementData(given.data)
    train_displacement(
        snakemake.output[0],
        new_displacement(
            snakemake.wildcards.field,
            data,
            {gender: load_body(given[gender]) for gender in GENDERS},
            load_clusters(given.fields),
            DisplacementSettings(**params.settings),
        ),
        data,
        code=params.code,
        progress=params.progress,
        trainer=params.trainer,
        threads=snakemake.threads,
    )
