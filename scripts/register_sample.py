"""Rule `register_sample`: the garments of a simulated sample, registered in their rest pose."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.registration.to_body.registrar import Registrar
from drapeline.registration.to_body.samples import register_sample
from drapeline.registration.to_body.topology import load_topology
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    status = register_sample(
        snakemake.output[0],
        snakemake.input.sample,
        Registrar(load_topology(snakemake.input.topology)),
        {gender: load_body(snakemake.input[gender]) for gender in GENDERS},
    )
    log.info("sample %s is %s", snakemake.wildcards.sample, status)
