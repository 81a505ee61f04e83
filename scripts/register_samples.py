"""Rule `register_samples`: the garments of simulated samples, registered in their rest pose."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.dataset.shards import samples_of
from drapeline.frames import GENDERS
from drapeline.registration.to_body.registrar import Registrar, register_sample
from drapeline.registration.to_body.topology import load_topology
from drapeline.rule_log import progress, rule_log
from drapeline.storage import atomic_folder

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    registrar = Registrar(load_topology(snakemake.input.topology))
    bodies = {gender: load_body(snakemake.input[gender]) for gender in GENDERS}
    samples = samples_of([snakemake.input.samples])
    with atomic_folder(snakemake.output[0]) as folder:
        for sample in progress(samples, total=len(samples), label="samples"):
            status = register_sample(folder / sample.name, sample, registrar, bodies)
            log.info("%s is %s", sample.name, status)
