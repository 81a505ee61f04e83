"""Rule `plot_gcvae_wrinkles`: figure 10, wrinkle codes on other poses and garments."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.learning_data.moving import moving_files_test_first
from drapeline.models.gcvae.figures import wrinkle_rows
from drapeline.models.gcvae.load import load_codec, load_dynamic_garments
from drapeline.models.training.module import BEST
from drapeline.registration.to_body.topology import load_topology
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.gcvae.figures import worn_view
from drapeline.report.models.scene import plot_views
from drapeline.rule_log import rule_log
from drapeline.seeding import rng_for

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    given = snakemake.input
    rows = wrinkle_rows(
        rng_for(snakemake.params.seed, "wrinkle codes"),
        load_codec(Path(given.dvae) / BEST),
        load_dynamic_garments(given.dynamic, given.static, snakemake.params.frames),
        moving_files_test_first(given.samples, given.registrations),
        {gender: load_body(given[f"super_{gender}"]) for gender in GENDERS},
        {gender: load_body(given[gender]) for gender in GENDERS},
        load_topology(given.topology),
        snakemake.params.columns,
    )
    views = {name: [worn_view(worn) for worn in row] for name, row in rows.items()}
    plot_views(snakemake.output[0], views)
