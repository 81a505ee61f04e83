"""Setting a retargeted motion on the floor."""

from drapeline.motions.floor import lift_out, rest_supports
from drapeline.motions.foot_lock import lock_feet
from drapeline.motions.hands import lay_hands
from drapeline.motions.motion import Motion


def set_on_floor(motion: Motion, *, feet: bool = True, hands: bool = True) -> Motion:
    """Bring a motion to the floor z = 0 of the reference skeleton.

    The root is raised or lowered so that supports rest on the floor, then legs are bent so that
    resting feet neither slide nor float, wrists so that hands lie on the floor, and what is
    still below it (knees, elbows) is lifted out. A cyclic motion stays cyclic.

    Args:
        motion: a motion on any floor.
        feet: whether legs may be bent.
        hands: whether wrists may be bent.
    """
    motion = rest_supports(motion)
    if feet:
        motion = lock_feet(motion)
    if hands:
        motion = lay_hands(motion)
    return lift_out(motion)
