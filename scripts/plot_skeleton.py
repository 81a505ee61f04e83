"""Rule `plot_skeleton`: the skeleton of a clip and the joints of it that drive bodies."""

from typing import TYPE_CHECKING

from drapeline.motions.importing import read_take
from drapeline.report.skeletons import plot_skeleton
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    take, joint_map = read_take(
        snakemake.input.motion,
        joint_map=snakemake.input.get("joint_map"),
        asf=snakemake.input.get("asf"),
    )
    plot_skeleton(snakemake.output[0], take, joint_map)
    log.info("%d joints: %s", len(joint_map.joints), joint_map.name)
