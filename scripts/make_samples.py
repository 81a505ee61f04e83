"""Rule `make_samples`: samples of a shard from their bodies to their pictures."""

import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.experiment.shards import deliver, files_in_shard, shard_settings
from drapeline.rule_log import rule_log
from drapeline.storage import write_json

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

RUN = [
    *(sys.executable, "-m", "snakemake", "--executor", "local", "--scheduler", "greedy"),
    *("--profile", "none", "--workflow-profile", "none", "--nolock", "--no-hooks"),
    *("--keep-going", "--rerun-incomplete", "--rerun-triggers", "input", "mtime", "params"),
]
with rule_log(snakemake.log[0]) as log:
    folder = Path(snakemake.params.folder)
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "config.json", shard_settings(snakemake.config, str(folder)))
    files = files_in_shard(snakemake.output, snakemake.config["results"], str(folder))
    snakefile = Path(snakemake.scriptdir).parent / "Snakefile"
    chosen = ["--snakefile", snakefile, "--configfile", folder / "config.json"]
    cores = ["--cores", str(snakemake.threads)]
    with open(folder / "output.txt", "ab") as stream:
        subprocess.run([*RUN, *cores, *chosen, "--", *files], stdout=stream, stderr=stream)
    deliver(files)
    log.info("%d files and folders", len(files))
