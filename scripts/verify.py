"""Rule `verify`: whether dataset, samples and trained models are as they were written."""

import sys
from typing import TYPE_CHECKING

from drapeline.dataset.verify import verify_results
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    count = verify_results(snakemake.params.results)
    log.info("all files are as they were written (%d compared)", count)
    sys.stdout.write(f"drapeline: all files are as they were written ({count} compared)\n")
