"""Rule `verify`: whether dataset, samples, trained models and all else are as they were written."""

import sys
from typing import TYPE_CHECKING

from drapeline.dataset.verify import verify_results
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    found = verify_results(snakemake.params.results)
    words = f"all files are as they were written ({found.compared} compared, {found.read} read)"
    log.info("%s", words)
    sys.stdout.write(f"drapeline: {words}\n")
