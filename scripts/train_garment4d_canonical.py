"""Rule `train_garment4d_canonical`: a garment's points and its shape at rest; or PN++."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.models.garment4d.body_input import BodySet
from drapeline.models.garment4d.data import SequenceData
from drapeline.models.garment4d.train import train_canonical
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params = snakemake.input, snakemake.params
    bodies = {gender: load_body(given[gender]) for gender in GENDERS}
    train_canonical(
        snakemake.output[0],
        SequenceData(given.data, BodySet(bodies, params.body_points)),
        params.settings,
        pointnet=snakemake.wildcards.canonical == "pointnet",
        code=params.code,
        progress=params.progress,
        trainer=params.trainer,
        threads=snakemake.threads,
    )
