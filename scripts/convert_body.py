"""Rule `convert_body`: a baked body as the pickle that smplx opens by path."""

from typing import TYPE_CHECKING

from drapeline.bodies.smpl_files import convert_to_pickle
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    convert_to_pickle(snakemake.input[0], snakemake.output[0])
    log.info("wrote %s", snakemake.output[0])
