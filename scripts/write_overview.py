"""Rule `write_overview`: the front page of the report, as soon as the samples are there."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.report.overview import write_overview
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    write_overview(
        snakemake.output[0],
        snakemake.input.dataset,
        {
            path.stem: path
            for shard in snakemake.input.pictures
            for path in Path(shard).glob("*[0-9].png")
        },
    )
    gallery = Path(snakemake.output[0]).parents[1] / "gallery"
    sys.stdout.write(
        f"drapeline: all samples are there to be looked at: {snakemake.output[0]}, {gallery}\n"
    )
