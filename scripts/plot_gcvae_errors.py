"""Rule `plot_gcvae_errors`: figure 7, reconstructions and their errors, at rest and in motion."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.learning_data.moving import moving_files_test_first
from drapeline.learning_data.static import StaticData
from drapeline.models.gcvae.codec import load_codes
from drapeline.models.gcvae.figures import moving_cases, static_cases
from drapeline.models.gcvae.load import load_codec, load_dynamic_garments
from drapeline.models.training.module import BEST
from drapeline.registration.to_body.topology import load_topology
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.gcvae.figures import ERROR_COLUMNS, error_views
from drapeline.report.models.scene import plot_views
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    given = snakemake.input
    bodies = {gender: load_body(given[gender]) for gender in GENDERS}
    cases = static_cases(
        load_codec(Path(given.svae) / BEST),
        StaticData(given.data),
        load_codes(given.codes)[0],
        given.outfits,
        bodies,
    )
    cases += moving_cases(
        load_codec(Path(given.dvae) / BEST),
        load_dynamic_garments(given.dynamic, given.static, snakemake.params.frames),
        moving_files_test_first(given.samples, given.registrations),
        {gender: load_body(given[f"super_{gender}"]) for gender in GENDERS},
        bodies,
        load_topology(given.topology),
    )
    rows = {case.label: error_views(case) for case in cases}
    plot_views(snakemake.output[0], rows, columns=ERROR_COLUMNS, heat=True)
