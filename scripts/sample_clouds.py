"""Rule `sample_clouds`: labelled point clouds of every frame of simulated samples."""

from typing import TYPE_CHECKING

from drapeline.dataset.point_clouds import write_clouds
from drapeline.dataset.settings import CloudSettings
from drapeline.dataset.shards import samples_of
from drapeline.rule_log import rule_log
from drapeline.storage import atomic_folder

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    settings = CloudSettings(**snakemake.params.settings)
    with atomic_folder(snakemake.output[0]) as folder:
        for sample in samples_of(snakemake.input):
            status = write_clouds(folder / sample.name, sample, settings)
            log.info("%s is %s", sample.name, status)
