"""Rule `sample_clouds`: a labelled point cloud of every frame of a simulated sample."""

from typing import TYPE_CHECKING

from drapeline.dataset.point_clouds import write_clouds
from drapeline.dataset.settings import CloudSettings
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    settings = CloudSettings(**snakemake.params.settings)
    log.info(write_clouds(snakemake.output[0], snakemake.input[0], settings))
