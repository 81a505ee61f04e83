"""A random body in its piece of a clip (CLOTH3D 3.1)."""

from drapeline.bodies.animation import first_free_sequence
from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import sample_shape
from drapeline.bodies.sequence import BodySequence, ClipLabels
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.generation.settings import BodySettings
from drapeline.motions.motion import Motion
from drapeline.motions.variation import cut_piece
from drapeline.seeding import rng_for


def animate(
    plan: SamplePlan, motion: Motion, body: BodyModel, settings: BodySettings, seed: int
) -> BodySequence:
    """A random body of the planned gender in a piece of a clip at 30 fps, without collisions."""
    piece = cut_piece(motion, plan.start, plan.stop, speed=plan.speed, mirrored=plan.mirrored)
    shapes = rng_for(seed, "shape", plan.sample)
    return first_free_sequence(
        body,
        (
            sample_shape(shapes, body, settings.shape_range, settings.bmi_range)
            for _ in range(settings.shape_draws)
        ),
        piece.poses,
        piece.trans,
        gender=plan.gender,
        reference_leg_length_m=motion.reference_leg_length_m,
        removable=plan.removable,
        shape_range=settings.shape_range,
        gap_m=settings.segment_gap_m,
        adapt=settings.fit_motion,
        labels=ClipLabels(
            plan.sub_sequence,
            motion.action,
            motion.subject,
            motion.source,
            plan.start,
            plan.speed,
            plan.mirrored,
        ),
    )
