"""Rule `compare_garment4d`: held-out garments as templates and as their principal components."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.learning_data.static import StaticData
from drapeline.metrics.table import write_metrics
from drapeline.models.compare import compare_representations, held_out_garments
from drapeline.models.garment4d.representation import RegisteredTemplate, TemplatePca
from drapeline.outfits.static import load_static
from drapeline.registration.to_template.garment_space import load_space
from drapeline.registration.to_template.remesh import load_tables
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params = snakemake.input, snakemake.params
    spaces = {name: load_space(Path(given[name]) / "space.npz") for name in params.garments}
    tables = {name: load_tables(given.fits, name) for name in params.garments}
    outfits = (outfit for shard in given.outfits for outfit in load_static(shard))
    rows = compare_representations(
        held_out_garments(StaticData(given.data), outfits, params.garments, params.split),
        [RegisteredTemplate(spaces, tables), TemplatePca(spaces, tables)],
        split=params.split,
        seed=params.seed,
    )
    write_metrics(snakemake.output[0], rows)
