"""Rule `plot_gcvae_codes`: figure 8, the codes of static garments in the plane."""

from typing import TYPE_CHECKING

from drapeline.models.gcvae.codec import load_codes
from drapeline.outfits.garment_types import GARMENTS
from drapeline.report.models.gcvae.figures import plot_codes
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    codes, about = load_codes(snakemake.input[0])
    types = [GARMENTS[garment_index] for garment_index in about["garment"]]
    plot_codes(snakemake.output[0], codes.mean, types, about["split"])
