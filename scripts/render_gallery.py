"""Rule `render_gallery`: a still and a moving picture of each sample."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.dataset.shards import samples_of
from drapeline.rendering.raytracer import ray_share
from drapeline.report.dataset.gallery import render_gallery, write_index
from drapeline.rule_log import rule_log
from drapeline.storage import atomic_folder

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    with atomic_folder(snakemake.output[0]) as folder:
        for sample in samples_of(snakemake.input):
            still, moving = (folder / f"{sample.name}{end}.png" for end in ("", "_moving"))
            render_gallery(sample, still, moving)
    gallery = Path(snakemake.output[0]).parents[1]
    if not (gallery / "index.html").exists():
        sys.stdout.write(f"drapeline: first pictures: {gallery}/index.html, which fills up\n")
    write_index(gallery)
