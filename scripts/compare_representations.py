"""Rule `compare_representations`: held-out garments through the codes of all models."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.learning_data.static import StaticData
from drapeline.metrics.table import write_metrics
from drapeline.models.compare import compare_representations
from drapeline.models.gcvae.load import load_vae
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import TEMPLATE_TYPES
from drapeline.outfits.static import load_static
from drapeline.registration.to_template.garment_space import load_space
from drapeline.registration.to_template.remesh_table import load_tables
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params = snakemake.input, snakemake.params
    rows = compare_representations(
        StaticData(given.data),
        [outfit for shard in given.outfits for outfit in load_static(shard)],
        {Path(folder).name: load_vae(Path(folder) / BEST) for folder in given.models},
        {name: load_space(Path(given[name]) / "space.npz") for name in TEMPLATE_TYPES},
        {name: load_tables(given.fits, name) for name in TEMPLATE_TYPES},
        components=params.components,
        split=params.split,
        seed=params.seed,
    )
    write_metrics(snakemake.output[0], rows)
