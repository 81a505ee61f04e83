"""Rule `animate_bodies`: random bodies, moving through their clips, free of self-collisions."""

from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.bodies.sequence import save_body_sequence
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.frames import GENDERS
from drapeline.generation.body import animate
from drapeline.generation.settings import BodySettings
from drapeline.motions.motion import load_motion
from drapeline.rule_log import progress, rule_log
from drapeline.storage import atomic_folder

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given, params = snakemake.input, snakemake.params
    bodies = {gender: load_body(given[gender]) for gender in GENDERS}
    clips = {motion.sequence: motion for motion in map(load_motion, given.motions)}
    plans, settings = [SamplePlan(**plan) for plan in params.plans], BodySettings(**params.settings)
    with atomic_folder(snakemake.output[0]) as folder:
        for plan in progress(plans, total=len(plans), label="bodies"):
            clip, body = clips[plan.sequence], bodies[plan.gender]
            record = animate(plan, clip, body, settings, params.seed)
            save_body_sequence(Path(folder) / f"{plan.sample}.npz", record)
            log.info(
                "%s on %s: self-collision %s", plan.sample, record.labels.sequence, record.outcome
            )
