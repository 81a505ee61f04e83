"""Rule `scan_samples`: segmented scans of simulated samples, with the bodies that fit them."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.bodies.settings import BodyFit
from drapeline.dataset.scan_bodies import scan_samples
from drapeline.dataset.settings import ScanSettings
from drapeline.dataset.shards import samples_named
from drapeline.frames import GENDERS
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params = snakemake.input, snakemake.params
    scan_samples(
        snakemake.output[0],
        samples_named([given.samples], params.samples),
        {gender: load_body(given[gender]) for gender in GENDERS},
        settings=ScanSettings(**params.scans),
        fit=BodyFit(**params.body),
        seed=params.seed,
    )
