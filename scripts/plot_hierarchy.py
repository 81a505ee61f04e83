"""Rule `plot_hierarchy`: pictures of the two topologies and of the meshes for pooling."""

from typing import TYPE_CHECKING

from drapeline.registration.to_body.hierarchy import POOLINGS, load_hierarchy
from drapeline.registration.to_body.topology import load_topology
from drapeline.rendering.raytracer import ray_share
from drapeline.report.registration_sheets import plot_hierarchies, plot_topologies
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    topology = load_topology(snakemake.input.topology)
    plot_topologies(snakemake.output.topologies, topology)
    hierarchies = {pooling: load_hierarchy(snakemake.input[pooling]) for pooling in POOLINGS}
    plot_hierarchies(snakemake.output.hierarchy, topology, hierarchies)
