"""Rule `import_learning_motions`: the clips that samples of the learning group are pieces of."""

from typing import TYPE_CHECKING

from drapeline.motions.importing import import_motion
from drapeline.motions.motion import save_motion
from drapeline.rule_log import progress, rule_log
from drapeline.storage import atomic_folder

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    clips = snakemake.params.clips
    with atomic_folder(snakemake.output[0]) as folder:
        for name, clip in progress(clips.items(), total=len(clips), label="clips"):
            motion = import_motion(clip.pop("motion"), **clip)
            save_motion(folder / f"{name}.npz", motion)
            log.info("%s: %d frames of '%s'", name, len(motion), motion.action)
