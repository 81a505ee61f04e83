"""Rule `build_super_body`: refined bodies without head, hands and feet; their two topologies."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body, save_body
from drapeline.frames import GENDERS
from drapeline.registration.to_body.super_body import build_super_body
from drapeline.registration.to_body.topology import build_topology, save_topology
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    refined = build_super_body(
        {gender: load_body(snakemake.input[gender]) for gender in GENDERS},
        snakemake.params.vertices,
    )
    for gender, body in refined.bodies.items():
        save_body(snakemake.output[gender], body)
    topology = build_topology(refined)
    save_topology(snakemake.output.topology, topology)
    log.info("%d vertices, %d faces", len(topology.rest), len(topology.faces))
    log.info("symmetric: %s", refined.mirror is not None)
