"""Rule `pack_models`: trained models as they come with drapeline, each with a card."""

import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

from drapeline.job import Job
from drapeline.models.package import pack_models
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    root = Path(snakemake.scriptdir).parent
    asked = ["git", "-C", str(root), "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(asked, capture_output=True, text=True, check=False).stdout.strip()
    told = SimpleNamespace(**snakemake.params.told)
    told.about = {**told.about, "commit": commit or "unknown"}
    pack_models(Job(snakemake.input, snakemake.output, told))
