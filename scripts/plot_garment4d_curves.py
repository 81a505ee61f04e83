"""Rule `plot_garment4d_curves`: ablations of figure 6 and curves of figures 8 to 10."""

from typing import TYPE_CHECKING

from drapeline.metrics.garment4d import MODEL
from drapeline.report.models.garment4d.figures import (
    plot_ablation,
    plot_accuracy_curve,
    plot_missing_curve,
    plot_neighbour_curve,
)
from drapeline.report.tables import read_test_metrics
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    rows = read_test_metrics(snakemake.input[0], [MODEL])
    plot_ablation(snakemake.output.ablation, rows, snakemake.params.garment)
    plot_neighbour_curve(snakemake.output.neighbours, rows)
    plot_missing_curve(snakemake.output.missing, rows)
    plot_accuracy_curve(snakemake.output.accuracy, rows)
