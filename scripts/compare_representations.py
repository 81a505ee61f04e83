"""Rule `compare_representations`: held-out garments through the codes of all models."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.metrics.table import write_metrics
from drapeline.nets.checkpoints import load_vae
from drapeline.nets.representations import compare_representations
from drapeline.nets.trained import BEST
from drapeline.outfits.kinds import TEMPLATE_TYPES
from drapeline.outfits.static import load_static
from drapeline.registration.garment_space import load_space
from drapeline.registration.static_data import StaticData
from drapeline.registration.template_tables import load_tables
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
