"""Rule `skin_outfits`: outfits at rest moved by skinning through captured motion, as clouds."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.dataset.shards import samples_of
from drapeline.frames import GENDERS
from drapeline.learning_data.settings import SkinnedSettings
from drapeline.learning_data.skinned import write_skinned
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given, params = snakemake.input, snakemake.params
    count = write_skinned(
        snakemake.output[0],
        given.outfits,
        samples_of(given.samples),
        {gender: load_body(given[gender]) for gender in GENDERS},
        SkinnedSettings(frames=params.frames, step=params.step, clouds=params.clouds),
    )
    log.info("%d outfits", count)
