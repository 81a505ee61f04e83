"""Rule `plot_gcvae_wrinkles`: figure 10, wrinkle codes on other poses and garments."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.metrics.motion import shown_moving
from drapeline.nets.cases import wrinkle_rows
from drapeline.nets.checkpoints import load_vae
from drapeline.nets.dynamic_data import dynamic_garments
from drapeline.nets.trained import BEST
from drapeline.registration.topology import load_topology
from drapeline.report.gcvae_figures import plot_views, worn_view
from drapeline.report.studio import ray_share
from drapeline.rule_log import rule_log
from drapeline.seeding import rng_for

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    given = snakemake.input
    rows = wrinkle_rows(
        rng_for(snakemake.params.seed, "wrinkle codes"),
        load_vae(Path(given.dvae) / BEST),
        dynamic_garments(given.dynamic, given.static, snakemake.params.frames),
        shown_moving(given.samples, given.registrations),
        {gender: load_body(given[f"super_{gender}"]) for gender in GENDERS},
        {gender: load_body(given[gender]) for gender in GENDERS},
        load_topology(given.topology),
        snakemake.params.columns,
    )
    views = {name: [worn_view(worn) for worn in row] for name, row in rows.items()}
    plot_views(snakemake.output[0], views)
