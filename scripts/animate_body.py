"""Rule `animate_body`: a random body shape, moving through its clip, free of self-collisions."""

from typing import TYPE_CHECKING

from drapeline.bodies.animation import first_free_sequence
from drapeline.bodies.model import load_body
from drapeline.bodies.sampling import sample_shape
from drapeline.bodies.sequence import ClipLabels, save_body_sequence
from drapeline.frames import GENDERS
from drapeline.motions.motion import load_motion
from drapeline.rule_log import rule_log
from drapeline.seeding import rng_for

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    wanted = snakemake.params
    motion = load_motion(snakemake.input.motion)
    shapes = rng_for(wanted.seed, "shape", snakemake.wildcards.sample)
    record = first_free_sequence(
        load_body(snakemake.input.body),
        (sample_shape(shapes, wanted.shape_range) for _ in range(wanted.shape_draws)),
        motion.poses[wanted.start : wanted.stop],
        motion.trans[wanted.start : wanted.stop],
        gender=GENDERS.index(wanted.gender),
        reference_leg_length_m=motion.reference_leg_length_m,
        removable=wanted.removable,
        shape_range=wanted.shape_range,
        gap_m=wanted.segment_gap_m,
        labels=ClipLabels(
            wanted.sub_sequence, motion.action, motion.subject, motion.source, wanted.start
        ),
    )
    save_body_sequence(snakemake.output[0], record)
    log.info("%s: self-collision %s", record.labels.sequence, record.outcome)
