"""Rule `import_motion`: one captured clip as SMPL poses at 30 fps on the floor."""

from typing import TYPE_CHECKING

from drapeline.manifest import check_sum
from drapeline.motions.floor import floor_report
from drapeline.motions.importing import import_motion
from drapeline.motions.motion import save_motion
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    for name, expected in snakemake.params.sums.items():
        check_sum(snakemake.input[name], expected)
    motion = import_motion(
        snakemake.input.motion,
        joint_map=snakemake.input.get("joint_map"),
        asf=snakemake.input.get("asf"),
        **snakemake.params.motion,
    )
    save_motion(snakemake.output[0], motion)
    log.info("%s: %d frames of '%s'", motion.sequence, len(motion), motion.action)
    floor = floor_report(motion)
    log.info(
        "resting feet slide %.1f mm per frame, supports float %.1f mm, deepest below floor %.1f mm",
        floor.sliding_mm_per_frame,
        floor.floating_mean_mm,
        floor.penetration_max_mm,
    )
