"""Rule `build_hierarchy`: meshes of fewer and fewer vertices, for pooling."""

from typing import TYPE_CHECKING

from drapeline.registration.to_body.hierarchy import build_hierarchy, level_counts, save_hierarchy
from drapeline.registration.to_body.topology import load_topology
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    topology = load_topology(snakemake.input.topology)
    counts = level_counts(len(topology.rest))
    hierarchy = build_hierarchy(topology, snakemake.wildcards.pooling, counts)
    save_hierarchy(snakemake.output[0], hierarchy)
    log.info("vertices: %s", ", ".join(map(str, hierarchy.counts)))
